"""The memory-mapped world: which device answers at which address.

An access that no device knows reads as zero, changes nothing, and is counted by address; one to a device
whose clock is off does the same and is counted by device.
"""

from targets.jit import njit
from targets.mcu import (
    bxcan,
    crc,
    exti,
    flash,
    gating,
    gpio,
    identity,
    itm,
    iwdg,
    nvic,
    pwr,
    rcc,
    resets,
    scs,
    syscfg,
    tim,
    usart,
    wwdg,
)
from targets.mcu.state import RCC_RESET, UNMODELLED, UNMODELLED_MAX, State

PERIPHERALS = 0x40000000
PERIPHERALS_SIZE = 0x80000
SYSTEM = 0xE0000000
SYSTEM_SIZE = 0x100000


@njit(cache=True)
def count_unmodelled(S: State, address: int) -> None:
    """One more access to an address that nothing answers at; the list keeps the first addresses."""
    entries = S[UNMODELLED]
    for k in range(entries):
        if S[UNMODELLED + 1 + 2 * k] == address:
            S[UNMODELLED + 2 + 2 * k] += 1
            return
    if entries < UNMODELLED_MAX:
        S[UNMODELLED + 1 + 2 * entries] = address
        S[UNMODELLED + 2 + 2 * entries] = 1
        S[UNMODELLED] = entries + 1


@njit(cache=True)
def _is_timer(address: int) -> bool:
    return tim.ORIGIN <= address < tim.ORIGIN + 0x400 * tim.TIMERS


@njit(cache=True)
def _write_rcc(S: State, offset: int, value: int) -> bool:
    """Clocks may change: what counts them counts up to now at the old ones, and goes on at the new."""
    register = (offset - 0x10) // 4
    resets_devices = 0 <= register < 6
    before = S[RCC_RESET + register] if resets_devices else 0
    usart.service(S)
    tim.pause(S)
    wwdg.pause(S)
    known = rcc.write(S, offset, value)
    if resets_devices:
        known = resets.reset_by_bits(S, register, S[RCC_RESET + register] & ~before) and known
    tim.resume(S)
    wwdg.resume(S)
    return known


@njit(cache=True)
def _read_word(S: State, address: int) -> int:
    page, offset, unit = address & ~0x3FF, address & 0x3FF, usart.index(address)
    value = -1
    if bxcan.BASE <= address < bxcan.BASE + bxcan.SIZE:
        value = bxcan.read(S, address - bxcan.BASE)
    elif gpio.BASE <= address < gpio.BASE + 0x400 * gpio.PORTS:
        value = gpio.read(S, address - gpio.BASE)
    elif rcc.BASE <= address < rcc.BASE + 0x400:
        value = rcc.read(S, address - rcc.BASE)
    elif flash.BASE <= address < flash.BASE + 0x400:
        value = flash.read(S, address - flash.BASE)
    elif _is_timer(address):
        value = tim.read(S, address - tim.ORIGIN)
    elif unit >= 0:
        value = usart.read(S, unit, offset)
    elif page == exti.BASE:
        value = exti.read(S, offset)
    elif page == syscfg.BASE:
        value = syscfg.read(S, offset)
    elif page == crc.BASE:
        value = crc.read(S, offset)
    elif page == iwdg.BASE:
        value = iwdg.read(S, offset)
    elif page == wwdg.BASE:
        value = wwdg.read(S, offset)
    elif page == pwr.BASE:
        value = pwr.read(S, offset)
    elif identity.BASE <= address < identity.BASE + identity.SIZE:
        value = identity.read(S, address - identity.BASE)
    elif 0xE000E100 <= address < 0xE000E500:
        value = nvic.read(S, address - 0xE000E100)
    elif itm.BASE <= address < itm.BASE + itm.SIZE:
        value = itm.read(S, address - itm.BASE)
    elif address & ~0xFFF == itm.TPIU_BASE:
        value = itm.read_port(S, address - itm.TPIU_BASE)
    elif page == identity.DBGMCU_BASE:
        value = identity.read_debug(S, offset)
    elif address >= SYSTEM:
        value = scs.read(S, address)
    if value < 0:
        count_unmodelled(S, address)
        return 0
    return value & 0xFFFFFFFF


@njit(cache=True)
def _write_word(S: State, address: int, value: int) -> None:
    page, offset, unit = address & ~0x3FF, address & 0x3FF, usart.index(address)
    known = False
    if bxcan.BASE <= address < bxcan.BASE + bxcan.SIZE:
        known = bxcan.write(S, address - bxcan.BASE, value)
    elif gpio.BASE <= address < gpio.BASE + 0x400 * gpio.PORTS:
        known = gpio.write(S, address - gpio.BASE, value)
    elif rcc.BASE <= address < rcc.BASE + 0x400:
        known = _write_rcc(S, address - rcc.BASE, value)
    elif flash.BASE <= address < flash.BASE + 0x400:
        known = flash.write(S, address - flash.BASE, value)
        rcc.check_limits(S)
    elif _is_timer(address):
        known = tim.write(S, address - tim.ORIGIN, value)
    elif unit >= 0:
        known = usart.write(S, unit, offset, value)
    elif page == exti.BASE:
        known = exti.write(S, offset, value)
    elif page == syscfg.BASE:
        known = syscfg.write(S, offset, value)
    elif page == crc.BASE:
        known = crc.write(S, offset, value)
    elif page == iwdg.BASE:
        known = iwdg.write(S, offset, value)
    elif page == wwdg.BASE:
        known = wwdg.write(S, offset, value)
    elif page == pwr.BASE:
        known = pwr.write(S, offset, value)
        rcc.check_limits(S)
    elif 0xE000E100 <= address < 0xE000E500:
        known = nvic.write(S, address - 0xE000E100, value)
    elif itm.BASE <= address < itm.BASE + itm.SIZE:
        known = itm.write(S, address - itm.BASE, value)
    elif address & ~0xFFF == itm.TPIU_BASE:
        known = itm.write_port(S, address - itm.TPIU_BASE, value)
    elif page == identity.DBGMCU_BASE:
        known = identity.write_debug(S, offset, value)
    elif address >= SYSTEM:
        known = scs.write(S, address, value)
    if not known:
        count_unmodelled(S, address)


@njit(cache=True)
def load(S: State, address: int, size: int) -> int:
    """Read `size` bytes at `address`."""
    if not gating.answers(S, address):
        return 0
    word = _read_word(S, address & ~3)
    return word >> (8 * (address & 3)) & ((1 << (8 * size)) - 1)


@njit(cache=True)
def store(S: State, address: int, size: int, value: int) -> None:
    """Write `size` bytes at `address`; the rest of the word stays as it is."""
    if not gating.answers(S, address):
        return
    if itm.BASE <= address < itm.BASE + 0x80:  # a stimulus port passes on as many bytes as it is given
        itm.stimulate(S, (address - itm.BASE) // 4, size, value)
        return
    if size < 4:
        shift = 8 * (address & 3)
        mask = ((1 << (8 * size)) - 1) << shift
        value = _beside(S, address & ~3) & ~mask | value << shift & mask
    _write_word(S, address & ~3, value)


@njit(cache=True)
def _beside(S: State, address: int) -> int:
    """What a narrow write brings to the rest of its word: neither it nor finding it out may do anything."""
    unit = usart.index(address)
    if _acts_on_ones(address):
        return 0
    if unit >= 0:
        return 0 if address & 0x3FF == 4 * usart.DR else max(0, usart.peek(S, unit, address & 0x3FF))
    if _is_timer(address):
        return max(0, tim.peek(S, address - tim.ORIGIN))
    return _read_word(S, address)


@njit(cache=True)
def _acts_on_ones(address: int) -> bool:
    """A register in which a one does something and a zero nothing."""
    page, offset = address & ~0x3FF, address & 0x3FF
    if gpio.BASE <= address < gpio.BASE + 0x400 * gpio.PORTS:
        return offset == 4 * gpio.BSRR
    if page in (bxcan.BASE, bxcan.BASE + 0x400):  # MSR, TSR, RF0R, RF1R
        return 0x04 <= offset < 0x14
    if page == exti.BASE:
        return offset >= 4 * exti.SWIER
    if address >= SYSTEM:  # NVIC's enable and pending registers; ICSR; CFSR, HFSR, DFSR
        return 0xE000E100 <= address < 0xE000E300 or address in (
            0xE000ED04,
            0xE000ED28,
            0xE000ED2C,
            0xE000ED30,
        )
    return False
