"""Reset and clock control (RM0090 section 7): the CPU's frequency is what the firmware sets here."""

from targets.jit import njit
from targets.mcu import limits
from targets.mcu.clock import cycles_at, now_cycles, now_ns, set_hz
from targets.mcu.state import (
    ATTEND,
    HZ,
    PWR_CR,
    RCC_BDCR,
    RCC_CFGR,
    RCC_CIR,
    RCC_CR,
    RCC_CSR,
    RCC_ENABLE,
    RCC_LOW_POWER,
    RCC_PLLCFGR,
    RCC_PLLI2SCFGR,
    RCC_READY_NS,
    RCC_READY_SEEN,
    RCC_RESET,
    RCC_SOURCE,
    RCC_SSCGR,
    State,
)

BASE = 0x40023800
IRQ = 5
HSI_HZ = 16_000_000
HSE_HZ = 8_000_000
"""The crystal of the thesis's board is not stated; 8 MHz is the usual one."""

NEVER = 1 << 62
# Start-up times, typical (DS8626 tables 32 to 36; the PLL's 75 us at 192 MHz to 150 us)
LSI_START_NS = 15_000
LSE_START_NS = 2_000_000_000
HSI_START_NS = 2_200
HSE_START_NS = 2_000_000
PLL_LOCK_NS = 100_000

# Bits of CIR, in whose order RCC_READY_NS lies
LSI, LSE, HSI, HSE, PLL, PLLI2S = range(6)

POWER_ON, SOFTWARE, INDEPENDENT_WATCHDOG, WINDOW_WATCHDOG = range(4)
_FLAGS = {POWER_ON: 0x0E000000, SOFTWARE: 0x14000000, INDEPENDENT_WATCHDOG: 0x24000000}
_FLAGS[WINDOW_WATCHDOG] = 0x44000000
CAUSES = {
    SOFTWARE: "the firmware asked for a system reset",
    INDEPENDENT_WATCHDOG: "the independent watchdog was not fed",
    WINDOW_WATCHDOG: "the window watchdog was fed too late or too early",
}
"""What RESET_CAUSE says."""

# Implemented bits of the enable and reset registers: AHB1, AHB2, AHB3, reserved, APB1, APB2
_IMPLEMENTED = (0x7E7411FF, 0xF1, 1, 0, 0x36FEC9FF, 0x00075F33)


def reset(S: State, cause: int = POWER_ON) -> None:
    """Reset values of section 7.3; `cause` shows in CSR. The backup domain survives all but power-on."""
    S[RCC_CR] = 0x83
    S[RCC_PLLCFGR] = 0x24003010
    S[RCC_CFGR] = S[RCC_SOURCE] = S[RCC_CIR] = S[RCC_SSCGR] = 0
    S[RCC_PLLI2SCFGR] = 0x20003000
    S[RCC_ENABLE : RCC_ENABLE + 6] = (0x00100000, 0, 0, 0, 0, 0)
    S[RCC_LOW_POWER : RCC_LOW_POWER + 6] = (0x7E6791FF, 0xF1, 1, 0, 0x36FEC9FF, 0x00075F33)
    S[RCC_RESET : RCC_RESET + 6] = 0
    if cause == POWER_ON:
        S[RCC_BDCR] = S[RCC_CSR] = 0
        S[RCC_READY_NS + LSE] = NEVER
    S[RCC_CSR] = S[RCC_CSR] & ~1 | _FLAGS[cause]
    for oscillator in (LSI, HSE, PLL, PLLI2S):
        S[RCC_READY_NS + oscillator] = NEVER
    S[RCC_READY_NS + HSI] = -NEVER
    S[RCC_READY_SEEN] = 1 << HSI


@njit(cache=True)
def pll_hz(S: State) -> int:
    """Frequency of the main PLL's output P, 0 if PLLCFGR holds a value that is not allowed."""
    pll = S[RCC_PLLCFGR]
    m, n, p = pll & 0x3F, pll >> 6 & 0x1FF, 2 * (pll >> 16 & 3) + 2
    if m < 2 or n < 50 or n > 432:
        return 0
    return (HSE_HZ if pll >> 22 & 1 else HSI_HZ) * n // (m * p)


@njit(cache=True)
def frequency(S: State) -> int:
    """SYSCLK / AHB prescaler, Hz, from the registers; 0 if the PLL drives it and cannot."""
    hz = HSI_HZ
    if S[RCC_SOURCE] == 1:
        hz = HSE_HZ
    elif S[RCC_SOURCE] == 2:
        hz = pll_hz(S)
    ahb = (S[RCC_CFGR] >> 4) & 0xF
    if ahb >= 8:
        shift = ahb - 7
        hz >>= shift if ahb < 12 else shift + 1  # 2 4 8 16, then 64 128 256 512
    return hz


@njit(cache=True)
def _apb_divisor(ppre: int) -> int:
    return 1 if ppre < 4 else 2 << (ppre - 4)


@njit(cache=True)
def apb1_divisor(S: State) -> int:
    """What divides AHB's clock for APB1, where CAN is."""
    return _apb_divisor((S[RCC_CFGR] >> 10) & 7)


@njit(cache=True)
def apb2_divisor(S: State) -> int:
    """What divides AHB's clock for APB2."""
    return _apb_divisor((S[RCC_CFGR] >> 13) & 7)


@njit(cache=True)
def apb1_hz(S: State) -> int:
    """PCLK1, Hz."""
    return S[HZ] // apb1_divisor(S)


@njit(cache=True)
def apb2_hz(S: State) -> int:
    """PCLK2, Hz."""
    return S[HZ] // apb2_divisor(S)


@njit(cache=True)
def timer_divisor(S: State) -> int:
    """CPU cycles in a clock of APB1's timers: twice PCLK1 unless that is undivided (section 7.2)."""
    divisor = apb1_divisor(S)
    return divisor if divisor == 1 else divisor // 2


@njit(cache=True)
def ready(S: State) -> int:
    """Which oscillators and PLLs are ready, a bit each in the order of CIR."""
    now, bits = now_ns(S), 0
    for oscillator in range(6):
        if now >= S[RCC_READY_NS + oscillator]:
            bits |= 1 << oscillator
    return bits


@njit("void(int64[::1], int64, int64, int64, int64)", cache=True)
def _switch(S: State, oscillator: int, before: int, after: int, delay_ns: int) -> None:
    """An oscillator's enable bit goes from `before` to `after`."""
    if after and not before:
        S[RCC_READY_NS + oscillator] = now_ns(S) + delay_ns
    elif before and not after:
        S[RCC_READY_NS + oscillator] = NEVER


@njit(cache=True)
def start_lsi(S: State) -> None:
    """The independent watchdog keeps the LSI on (section 7.2.5)."""
    _switch(S, LSI, S[RCC_CSR] & 1, 1, LSI_START_NS)
    S[RCC_CSR] |= 1


@njit(cache=True)
def _waited_for(S: State) -> int:
    """The oscillators whose readiness brings something about: an interrupt, or the switch to them."""
    waited, wanted = S[RCC_CIR] >> 8 & 0x3F & ~S[RCC_READY_SEEN], S[RCC_CFGR] & 3
    return waited if wanted == S[RCC_SOURCE] or wanted == 3 else waited | 1 << (HSI + wanted)


@njit(cache=True)
def due(S: State) -> int:
    """CPU cycles at which a start-up ends that something waits for."""
    waited, at = _waited_for(S), NEVER
    if waited == 0:
        return NEVER
    for oscillator in range(6):
        if waited >> oscillator & 1 and S[RCC_READY_NS + oscillator] < NEVER:
            at = min(at, cycles_at(S, S[RCC_READY_NS + oscillator]))
    return at


@njit(cache=True)
def _follow(S: State) -> bool:
    """Report what has become ready, switch SYSCLK if it was waited for; whether the CPU's clock changed."""
    bits = ready(S)
    S[RCC_CIR] |= bits & ~S[RCC_READY_SEEN] & S[RCC_CIR] >> 8 & 0x3F
    S[RCC_READY_SEEN] = bits
    wanted = S[RCC_CFGR] & 3
    if wanted != S[RCC_SOURCE] and wanted < 3 and bits >> (HSI + wanted) & 1:
        S[RCC_SOURCE] = wanted
    hz = frequency(S)
    if hz in (S[HZ], 0):
        return False
    set_hz(S, hz, now_cycles(S))
    return True


@njit(cache=True)
def service(S: State) -> None:
    """Do what the end of a start-up allows."""
    if _waited_for(S) and _follow(S):
        check_limits(S)


@njit(cache=True)
def check_limits(S: State) -> None:
    """Compare the buses' clocks with the data sheet."""
    limits.check(S, S[HZ], apb1_hz(S), apb2_hz(S))


@njit(cache=True)
def line(S: State) -> bool:
    """Level of the RCC's interrupt line."""
    return S[RCC_CIR] & S[RCC_CIR] >> 8 & 0x3F != 0


@njit(cache=True)
def _bank(offset: int) -> int:
    """The slot of a reset, enable or low-power enable register; -1 for any other offset."""
    table, word = (offset - 0x10) // 0x20, (offset - 0x10) % 0x20 // 4
    if offset < 0x10 or table > 2 or word == 3 or word > 5:
        return -1
    if table == 0:
        return RCC_RESET + word
    return (RCC_ENABLE if table == 1 else RCC_LOW_POWER) + word


@njit(cache=True)
def read(S: State, offset: int) -> int:
    """Value of the register at `offset`, -1 if it is not modelled."""
    bits = ready(S)
    if bits & _waited_for(S):
        S[ATTEND] = 1  # what follows from it is done at the next block
    if offset == 0x00:
        up = (bits >> HSI & 1) << 1 | (bits >> HSE & 1) << 17
        return S[RCC_CR] | up | (bits >> PLL & 1) << 25 | (bits >> PLLI2S & 1) << 27
    if offset == 0x04:
        return S[RCC_PLLCFGR]
    if offset == 0x08:
        return S[RCC_CFGR] | S[RCC_SOURCE] << 2
    if offset == 0x0C:
        return S[RCC_CIR]
    if _bank(offset) >= 0:
        return S[_bank(offset)]
    if offset == 0x70:
        return S[RCC_BDCR] | (bits >> LSE & 1) << 1
    if offset == 0x74:
        return S[RCC_CSR] | (bits >> LSI & 1) << 1
    if offset == 0x80:
        return S[RCC_SSCGR]
    if offset == 0x84:
        return S[RCC_PLLI2SCFGR]
    return -1


@njit(cache=True)
def _control(S: State, value: int) -> None:
    """CR written: what drives SYSCLK cannot be switched off (section 7.3.1)."""
    before, from_hse = S[RCC_CR], S[RCC_PLLCFGR] >> 22 & 1
    pll_used = S[RCC_SOURCE] == 2 or S[RCC_CFGR] & 3 == 2
    if pll_used:
        value |= 1 << 24
    if S[RCC_SOURCE] == 1 or (pll_used and from_hse):
        value |= 1 << 16
    if S[RCC_SOURCE] == 0 or (pll_used and not from_hse):
        value |= 1
    value &= 0x050D00F9
    S[RCC_CR] = before & 0xFF00 | value
    _switch(S, HSI, before & 1, value & 1, HSI_START_NS)
    _switch(S, HSE, before >> 16 & 1, value >> 16 & 1, 0 if value >> 18 & 1 else HSE_START_NS)
    source = S[RCC_READY_NS + (HSE if from_hse else HSI)]
    lock = NEVER if source == NEVER else max(0, source - now_ns(S)) + PLL_LOCK_NS
    if value >> 24 & ~(before >> 24) & 1 and not limits.check_pll(S, HSE_HZ if from_hse else HSI_HZ):
        lock = NEVER
    _switch(S, PLL, before >> 24 & 1, value >> 24 & 1, lock)
    _switch(S, PLLI2S, before >> 26 & 1, value >> 26 & 1, lock)


@njit(cache=True)
def _backup(S: State, value: int) -> None:
    """BDCR written: only while PWR_CR lets into the backup domain (section 7.3.20)."""
    if not S[PWR_CR] >> 8 & 1:
        return
    if value >> 16 & 1:
        value = 1 << 16
    _switch(S, LSE, S[RCC_BDCR] & 1, value & 1, 0 if value & 4 else LSE_START_NS)
    S[RCC_BDCR] = value & 0x00018305


@njit(cache=True)
def write(S: State, offset: int, value: int) -> bool:
    """Write the register at `offset`; False if it is not modelled."""
    S[ATTEND] = 1
    _follow(S)
    if offset == 0x00:
        _control(S, value)
    elif offset == 0x04:
        if S[RCC_CR] >> 24 & 1:  # section 7.3.2: to be written while the PLL is off
            limits.warn(S, limits.PLL_LOCKED, value)
        else:
            S[RCC_PLLCFGR] = value & 0x0F437FFF
    elif offset == 0x08:
        S[RCC_CFGR] = value & 0xFFFFFCF3
    elif offset == 0x0C:
        S[RCC_CIR] = S[RCC_CIR] & 0x3F & ~(value >> 16) | value & 0x3F00
    elif _bank(offset) >= 0:
        S[_bank(offset)] = value & _IMPLEMENTED[(offset - 0x10) % 0x20 // 4]
    elif offset == 0x70:
        _backup(S, value)
    elif offset == 0x74:
        _switch(S, LSI, S[RCC_CSR] & 1, value & 1, LSI_START_NS)
        S[RCC_CSR] = (0 if value >> 24 & 1 else S[RCC_CSR] & 0xFE000000) | value & 1
    elif offset == 0x80:
        S[RCC_SSCGR] = value
    elif offset == 0x84:
        S[RCC_PLLI2SCFGR] = value & 0x70007FC0
    else:
        return False
    if _follow(S) or offset == 0x08:
        check_limits(S)
    return True
