"""Reset and clock control (RM0090 section 7): the CPU's frequency is what the firmware sets here."""

from targets.jit import njit
from targets.mcu.clock import now_ns, set_hz
from targets.mcu.state import (
    CYCLES,
    HZ,
    RCC_CFGR,
    RCC_CR,
    RCC_ENABLE,
    RCC_HSE_AT,
    RCC_PLL_AT,
    RCC_PLLCFGR,
    State,
)

BASE = 0x40023800
HSI_HZ = 16_000_000
HSE_HZ = 8_000_000
"""The crystal of the thesis's board is not stated; 8 MHz is the usual one."""
HSE_START_NS = 2_000_000  # DS8626 table 32: 2 ms typical
PLL_LOCK_NS = 100_000  # DS8626 table 36: 75 us (192 MHz) to 150 us typical


def reset(S: State) -> None:
    """Reset values of section 7.3."""
    S[RCC_CR] = 0x83
    S[RCC_PLLCFGR] = 0x24003010
    S[RCC_CFGR] = 0
    S[RCC_ENABLE : RCC_ENABLE + 6] = (0x00100000, 0, 0, 0, 0, 0)


@njit(cache=True)
def frequency(S: State) -> int:
    """SYSCLK / AHB prescaler, Hz, from the registers; 0 if a divisor is 0."""
    source = S[RCC_CFGR] & 3
    hz = HSI_HZ
    if source == 1:
        hz = HSE_HZ
    elif source == 2:
        pll = S[RCC_PLLCFGR]
        m = pll & 0x3F
        n = (pll >> 6) & 0x1FF
        p = 2 * ((pll >> 16) & 3) + 2
        if m == 0:
            return 0
        hz = (HSE_HZ if pll >> 22 & 1 else HSI_HZ) * n // (m * p)
    ahb = (S[RCC_CFGR] >> 4) & 0xF
    if ahb >= 8:
        shift = ahb - 7
        hz >>= shift if ahb < 12 else shift + 1  # 2 4 8 16, then 64 128 256 512
    return hz


@njit(cache=True)
def apb1_divisor(S: State) -> int:
    """What divides AHB's clock for APB1, where CAN is."""
    ppre = (S[RCC_CFGR] >> 10) & 7
    return 1 if ppre < 4 else 2 << (ppre - 4)


@njit(cache=True)
def read(S: State, offset: int) -> int:
    """Value of the register at `offset`, -1 if it is not modelled."""
    if offset == 0x00:
        value = S[RCC_CR] & ~((1 << 17) | (1 << 25) | 2)
        now = now_ns(S)
        if value & 1:
            value |= 2
        if value >> 16 & 1 and now >= S[RCC_HSE_AT]:
            value |= 1 << 17
        if value >> 24 & 1 and now >= S[RCC_PLL_AT]:
            value |= 1 << 25
        return value
    if offset == 0x04:
        return S[RCC_PLLCFGR]
    if offset == 0x08:
        return S[RCC_CFGR] & ~0xC | (S[RCC_CFGR] & 3) << 2
    if 0x30 <= offset <= 0x44 and offset != 0x3C:
        return S[RCC_ENABLE + (offset - 0x30) // 4]
    return -1


@njit(cache=True)
def write(S: State, offset: int, value: int) -> bool:
    """Write the register at `offset`; False if it is not modelled."""
    if offset == 0x00:
        rising = value & ~S[RCC_CR]
        if rising >> 16 & 1:
            S[RCC_HSE_AT] = now_ns(S) + HSE_START_NS
        if rising >> 24 & 1:
            S[RCC_PLL_AT] = now_ns(S) + PLL_LOCK_NS
        S[RCC_CR] = value
    elif offset == 0x04:
        S[RCC_PLLCFGR] = value
    elif offset == 0x08:
        S[RCC_CFGR] = value
    elif 0x30 <= offset <= 0x44 and offset != 0x3C:
        S[RCC_ENABLE + (offset - 0x30) // 4] = value
        return True
    else:
        return False
    hz = frequency(S)
    if hz != S[HZ] and hz > 0:
        set_hz(S, hz, S[CYCLES])
    return True
