"""System control space beside the NVIC: SCB, FPU, and DWT's cycle counter (ARMv7-M B3, C1)."""

from targets.jit import njit
from targets.mcu import faults, mpu, nvic, preemption, systick
from targets.mcu.clock import now_cycles
from targets.mcu.preemption import BUS_FAULT, DEBUG_MONITOR, MEM_MANAGE, NMI, PEND_SV, SV_CALL, SYS_TICK
from targets.mcu.state import (
    ACTIVE_DEPTH,
    ACTLR,
    ATTEND,
    BFAR,
    CCR,
    CFSR,
    CPACR,
    DEMCR,
    DFSR,
    DWT_CTRL,
    DWT_OFFSET,
    FPCAR,
    FPCCR,
    HFSR,
    MMFAR,
    PRIGROUP,
    RESET_REQUEST,
    SCR,
    SET_UP,
    SHCSR,
    SYSTEM_PENDING,
    SYSTEM_PRIORITY,
    VTOR,
    State,
)

CPUID = 0x410FC241  # Cortex-M4 r0p1
M32 = 0xFFFFFFFF

DIV_0_TRP = 1 << 4
CCR_BITS = 0x31B  # STKALIGN, BFHFNMIGN, DIV_0_TRP, UNALIGN_TRP, USERSETMPEND, NONBASETHRDENA
SCR_BITS = 0x16  # SEVONPEND, SLEEPDEEP, SLEEPONEXIT
FPCCR_BITS = 0xC000017B
ENABLES = 0x70000  # of SHCSR: the three faults' enable bits

# Of the FPU (DDI 0439 section 7.3): MVFR0 and MVFR1
FPU_IDENTITY = (0x10110021, 0x11000011)


def reset(S: State) -> None:
    """Reset values; the vector table is at the start of flash, where the boot pins put it."""
    S[VTOR] = 0x08000000
    S[CCR] = 0x200
    S[FPCCR] = 0xC0000000
    S[DWT_CTRL] = 0x40000000
    systick.reset(S)
    mpu.reset(S)


@njit(cache=True)
def read(S: State, address: int) -> int:
    """Value of the register at `address`, -1 if it is not modelled."""
    if systick.BASE <= address < systick.BASE + 0x10:
        return systick.read(S, address - systick.BASE)
    if mpu.BASE <= address < mpu.BASE + mpu.SIZE:
        return mpu.read(S, address - mpu.BASE)
    if 0xE000ED18 <= address <= 0xE000ED20:
        return _priorities(S, address - 0xE000ED18 + 4)
    if 0xE000ED00 <= address < 0xE000ED40:
        return _read_control(S, address)
    if address == 0xE0001000:
        return S[DWT_CTRL]
    if address == 0xE0001004:
        return (now_cycles(S) - S[DWT_OFFSET]) & M32 if S[DWT_CTRL] & 1 else S[DWT_OFFSET] & M32
    if address == 0xE000E004:  # ICTR: interrupts in groups of 32, less one
        return nvic.IRQS // 32 - 1
    if address == 0xE000E008:
        return S[ACTLR]
    if address == 0xE000EDFC:
        return S[DEMCR]
    if address == 0xE000ED88:
        return S[CPACR]
    if address == 0xE000EF34:
        return S[FPCCR]
    if address == 0xE000EF38:
        return S[FPCAR]
    if address == 0xE000EF3C:  # FPDSCR
        return 0
    if address in (0xE000EF40, 0xE000EF44):
        return FPU_IDENTITY[(address - 0xE000EF40) // 4]
    return -1


@njit(cache=True)
def _read_control(S: State, address: int) -> int:
    if address == 0xE000ED00:
        return CPUID
    if address == 0xE000ED04:
        return _read_icsr(S)
    if address == 0xE000ED08:
        return S[VTOR]
    if address == 0xE000ED0C:
        return 0xFA050000 | S[PRIGROUP] << 8
    if address == 0xE000ED10:
        return S[SCR]
    if address == 0xE000ED14:
        return S[CCR]
    if address == 0xE000ED24:
        return _read_shcsr(S)
    if address == 0xE000ED28:
        return S[CFSR]
    if address == 0xE000ED2C:
        return S[HFSR]
    if address == 0xE000ED30:
        return S[DFSR]
    if address == 0xE000ED34:
        return S[MMFAR]
    if address == 0xE000ED38:
        return S[BFAR]
    if address == 0xE000ED3C:  # AFSR
        return 0
    return -1


@njit(cache=True)
def write(S: State, address: int, value: int) -> bool:
    """Write the register at `address`; False if it is not modelled."""
    if systick.BASE <= address < systick.BASE + 0x10:
        return systick.write(S, address - systick.BASE, value)
    if mpu.BASE <= address < mpu.BASE + mpu.SIZE:
        return mpu.write(S, address - mpu.BASE, value)
    if 0xE000ED18 <= address <= 0xE000ED20:
        _set_priorities(S, address - 0xE000ED18 + 4, value)
    elif 0xE000ED00 <= address < 0xE000ED40:
        return _write_control(S, address, value)
    elif address == 0xE0001000:
        _count(S, value & 1)
        S[DWT_CTRL] = 0x40000000 | value & 0xFFFFFFF
    elif address == 0xE0001004:
        S[DWT_OFFSET] = now_cycles(S) - value if S[DWT_CTRL] & 1 else value
    elif address == 0xE000E008:
        S[ACTLR] = value & 0x307
    elif address == 0xE000EDFC:
        S[DEMCR] = value
    elif address == 0xE000EF00:  # STIR
        if value & 0x1FF >= nvic.IRQS:
            return False
        nvic.latch(S, value & 0x1FF)
    elif address == 0xE000ED88:
        S[CPACR] = value & 0xF00000
        S[SET_UP] |= faults.FPU_ON
        S[ATTEND] |= 1
    elif address == 0xE000EF34:
        S[FPCCR] = value & FPCCR_BITS
        S[ATTEND] |= 1
    elif address == 0xE000EF38:
        S[FPCAR] = value & ~7
    elif address == 0xE000EF3C:  # FPDSCR: the engine begins every FP context with zero
        return value == 0
    else:
        return False
    return True


@njit(cache=True)
def _write_control(S: State, address: int, value: int) -> bool:
    if address == 0xE000ED04:
        _write_icsr(S, value)
    elif address == 0xE000ED08:
        S[VTOR] = value & 0xFFFFFF80
    elif address == 0xE000ED0C:
        if value >> 16 == 0x05FA:
            S[PRIGROUP] = value >> 8 & 7
            S[ATTEND] |= 1
            if value & 4:
                S[RESET_REQUEST] = 1
    elif address == 0xE000ED10:
        S[SCR] = value & SCR_BITS
    elif address == 0xE000ED14:
        S[CCR] = value & CCR_BITS
        if value & DIV_0_TRP:
            S[SET_UP] |= faults.DIVISIONS
            S[ATTEND] |= 1
    elif address == 0xE000ED24:
        _write_shcsr(S, value)
    elif address == 0xE000ED28:
        S[CFSR] &= ~value
    elif address == 0xE000ED2C:
        S[HFSR] &= ~value
    elif address == 0xE000ED30:
        S[DFSR] &= ~value
    elif address == 0xE000ED34:
        S[MMFAR] = value
    elif address == 0xE000ED38:
        S[BFAR] = value
    else:
        return False
    return True


@njit(cache=True)
def _priorities(S: State, first: int) -> int:
    value = 0
    for k in range(4):
        value |= S[SYSTEM_PRIORITY + first + k] << (8 * k)
    return value


@njit(cache=True)
def _set_priorities(S: State, first: int, value: int) -> None:
    """SHPR1 to SHPR3: four bits implemented; what no exception has is reserved."""
    for k in range(4):
        exception = first + k
        if (
            MEM_MANAGE <= exception <= preemption.USAGE_FAULT
            or exception in (SV_CALL, DEBUG_MONITOR)
            or exception >= PEND_SV
        ):
            S[SYSTEM_PRIORITY + exception] = value >> (8 * k) & 0xF0
    S[ATTEND] |= 1


@njit(cache=True)
def _read_icsr(S: State) -> int:
    """Interrupt control and state (B3.2.4)."""
    pending = S[SYSTEM_PENDING]
    external = 0
    for word in range(nvic.IRQS // 32):
        external |= nvic.pending_word(S, word)
    return (
        nvic.current(S)
        | (1 << 11 if S[ACTIVE_DEPTH] <= 1 else 0)
        | preemption.highest_pending(S, preemption.IDLE) << 12
        | (1 << 22 if external else 0)
        | (pending >> SYS_TICK & 1) << 26
        | (pending >> PEND_SV & 1) << 28
        | (pending >> NMI & 1) << 31
    )


@njit(cache=True)
def _write_icsr(S: State, value: int) -> None:
    if value >> 31 & 1:
        preemption.pend(S, NMI)
    if value >> 28 & 1:
        preemption.pend(S, PEND_SV)
    if value >> 27 & 1:
        preemption.unpend(S, PEND_SV)
    if value >> 26 & 1:
        preemption.pend(S, SYS_TICK)
    if value >> 25 & 1:
        preemption.unpend(S, SYS_TICK)


@njit(cache=True)
def _read_shcsr(S: State) -> int:
    """System handler control and state (B3.2.13): active, pending and enable bits."""
    value, pending = S[SHCSR], S[SYSTEM_PENDING]
    for exception, bit in ((4, 0), (5, 1), (6, 3), (11, 7), (12, 8), (14, 10), (15, 11)):
        value |= 1 << bit if nvic.is_active(S, exception) else 0
    for exception, bit in ((6, 12), (4, 13), (5, 14), (11, 15)):
        value |= (pending >> exception & 1) << bit
    return value


@njit(cache=True)
def _write_shcsr(S: State, value: int) -> None:
    """The active bits stay as they are: nothing but entry and return changes them here."""
    S[SHCSR] = value & ENABLES
    for exception, bit in ((6, 12), (MEM_MANAGE, 13), (BUS_FAULT, 14), (SV_CALL, 15)):
        if value >> bit & 1:
            preemption.pend(S, exception)
        else:
            preemption.unpend(S, exception)
    S[ATTEND] |= 1


@njit(cache=True)
def _count(S: State, enable: int) -> None:
    """CYCCNT starts or stops: while stopped the slot holds its value, while running the offset to CYCLES."""
    running = S[DWT_CTRL] & 1
    if enable and not running:
        S[DWT_OFFSET] = now_cycles(S) - S[DWT_OFFSET]
    elif running and not enable:
        S[DWT_OFFSET] = (now_cycles(S) - S[DWT_OFFSET]) & M32
