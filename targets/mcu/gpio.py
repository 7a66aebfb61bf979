"""General-purpose pins A to I (RM0090 section 8): registers, and the levels that they and the outside give.

A pin's edges are recorded with their time while it is an output. Timer channels (`tim`) drive pins in their
alternate function; the other alternate functions leave a pin to the outside and its pull.
"""

import numpy as np

from targets.jit import njit
from targets.mcu import exti, records
from targets.mcu.clock import now_cycles, ns_of
from targets.mcu.state import (
    CYCLES,
    CYCLES_MAX,
    CYCLES_MIN,
    GPIO,
    GPIO_PINS,
    GPIO_PINS_STRIDE,
    GPIO_STRIDE,
    TIM_OUTPUT,
    State,
)

BASE = 0x40020000
PORTS = 9
MODER, OTYPER, OSPEEDR, PUPDR, IDR, ODR, BSRR, LCKR, AFRL, AFRH = range(10)
_MODES = ((0xA8000000, 0x0C000000, 0x64000000), (0x00000280, 0x000000C0, 0x00000100))
"""MODER, OSPEEDR and PUPDR of ports A and B after reset: the debugger's pins."""

# What the registers come to, as masks of a port's 16 pins (state: GPIO_PINS)
LOCK_STEP, OUTPUT, ALTERNATE, ALTERNATE_HIGH, ANALOG, PULL_UP, DRIVEN, DRIVEN_HIGH, LEVEL = range(9)
LCKK = 1 << 16

TIMER_PINS = (
    (("PA0", "PA5", "PA15"), ("PA1", "PB3"), ("PA2", "PB10"), ("PA3", "PB11")),
    (("PA6", "PB4", "PC6"), ("PA7", "PB5", "PC7"), ("PB0", "PC8"), ("PB1", "PC9")),
    (("PB6", "PD12"), ("PB7", "PD13"), ("PB8", "PD14"), ("PB9", "PD15")),
    (("PA0", "PH10"), ("PA1", "PH11"), ("PA2", "PH12"), ("PA3", "PI0")),
)
"""TIM2 to TIM5, channels 1 to 4: the pins that alternate function 1 (TIM2) or 2 connects (DS8626 table 9)."""


def place(pin: str) -> int:
    """16 x port + number of a pin by its name: "PB3" -> 19. Raises ValueError for no such pin."""
    port, number = "ABCDEFGHI".find(pin[1:2]), pin[2:]
    if pin[:1] != "P" or port < 0 or not number.isdecimal() or int(number) > 15:
        raise ValueError(f"there is no pin {pin}")
    return 16 * port + int(number)


# (4 x timer + channel, k) -> 16 x port + number of its kth pin, -1 for none
_PINS = np.full((16, 3), -1, dtype=np.int64)
# (alternate function, 16 x port + pin) -> 4 x timer + channel, -1 for none
_CHANNELS = np.full((3, 16 * PORTS), -1, dtype=np.int64)
for _channel in range(16):
    for _k, _name in enumerate(TIMER_PINS[_channel // 4][_channel % 4]):
        _PINS[_channel, _k] = place(_name)
        _CHANNELS[1 if _channel < 4 else 2, place(_name)] = _channel


@njit(cache=True)
def reset(S: State, port: int) -> None:
    """Reset values of section 8.4; what drives the pins from outside goes on."""
    at = GPIO + GPIO_STRIDE * port
    for register in range(GPIO_STRIDE):
        S[at + register] = 0
    if port < 2:
        S[at + MODER], S[at + OSPEEDR], S[at + PUPDR] = _MODES[port]
    S[GPIO_PINS + GPIO_PINS_STRIDE * port + LOCK_STEP] = 0
    _configure(S, port)
    settle(S, port, now_cycles(S))


@njit(cache=True)
def channel_of(S: State, port: int, pin: int) -> int:
    """4 x timer + channel that a pin's alternate function connects it to, -1 for none."""
    at = GPIO + GPIO_STRIDE * port
    function = S[at + AFRL + pin // 8] >> (4 * (pin % 8)) & 0xF
    if S[at + MODER] >> (2 * pin) & 3 != 2 or function > 2:
        return -1
    return _CHANNELS[function, 16 * port + pin]


@njit(cache=True)
def _configure(S: State, port: int) -> None:
    """MODER, PUPDR or an alternate function has changed: the masks follow."""
    at, masks = GPIO + GPIO_STRIDE * port, GPIO_PINS + GPIO_PINS_STRIDE * port
    for mask in (OUTPUT, ALTERNATE, ALTERNATE_HIGH, ANALOG, PULL_UP):
        S[masks + mask] = 0
    for pin in range(16):
        mode = S[at + MODER] >> (2 * pin) & 3
        if mode == 1:
            S[masks + OUTPUT] |= 1 << pin
        elif mode == 3:
            S[masks + ANALOG] |= 1 << pin
        if S[at + PUPDR] >> (2 * pin) & 3 == 1:
            S[masks + PULL_UP] |= 1 << pin
        _connect(S, port, pin)


@njit(cache=True)
def _connect(S: State, port: int, pin: int) -> None:
    """The level of the timer channel behind a pin, if there is one and it is switched on."""
    masks, bit = GPIO_PINS + GPIO_PINS_STRIDE * port, 1 << pin
    channel = channel_of(S, port, pin)
    level = S[TIM_OUTPUT + channel] if channel >= 0 else -1
    S[masks + ALTERNATE] = S[masks + ALTERNATE] & ~bit | (bit if level >= 0 else 0)
    S[masks + ALTERNATE_HIGH] = S[masks + ALTERNATE_HIGH] & ~bit | (bit if level > 0 else 0)


@njit(cache=True)
def set_channel(S: State, channel: int, level: int, cycles: int) -> None:
    """A timer channel (4 x timer + channel) gives its pins another level at `cycles`, or lets go (-1)."""
    if S[TIM_OUTPUT + channel] == level:
        return
    S[TIM_OUTPUT + channel] = level
    for pin in _PINS[channel]:
        if pin >= 0:
            _connect(S, pin // 16, pin % 16)
            settle(S, pin // 16, cycles)


@njit(cache=True)
def settle(S: State, port: int, cycles: int) -> None:
    """Work out the pins' levels; those that have changed are edges at `cycles`."""
    at, masks = GPIO + GPIO_STRIDE * port, GPIO_PINS + GPIO_PINS_STRIDE * port
    driving = S[masks + OUTPUT] | S[masks + ALTERNATE]
    high = S[at + ODR] & S[masks + OUTPUT] | S[masks + ALTERNATE_HIGH]
    strong = driving & ~(S[at + OTYPER] & high)  # an open drain does not drive high
    outside = S[masks + DRIVEN] & ~strong
    level = high & strong | S[masks + DRIVEN_HIGH] & outside | S[masks + PULL_UP] & ~strong & ~outside
    level &= ~S[masks + ANALOG] & 0xFFFF
    rising, falling = level & ~S[masks + LEVEL], S[masks + LEVEL] & ~level
    if rising | falling == 0:
        return
    S[masks + LEVEL] = level
    exti.edge(S, port, rising, falling)
    for pin in range(16):
        if (rising | falling) & driving & 1 << pin:
            early, ns = cycles - S[CYCLES], ns_of(S, cycles)
            what = port << 5 | pin << 1 | level >> pin & 1
            edge = (ns, cycles, S[CYCLES_MIN] + early, S[CYCLES_MAX] + early, what)
            records.append(S, records.EDGES, edge)


@njit(cache=True)
def drive(S: State, port: int, mask: int, levels: int) -> None:
    """From outside, pins of `mask` are held at `levels`; the others of the port are let go."""
    masks = GPIO_PINS + GPIO_PINS_STRIDE * port
    S[masks + DRIVEN], S[masks + DRIVEN_HIGH] = mask & 0xFFFF, levels & mask & 0xFFFF
    settle(S, port, now_cycles(S))


@njit(cache=True)
def read(S: State, offset: int) -> int:
    """Value of the register at `offset` from port A's first, -1 if it is not modelled."""
    port, register = offset // 0x400, (offset % 0x400) // 4
    if register > AFRH:
        return -1
    if register == IDR:
        return S[GPIO_PINS + GPIO_PINS_STRIDE * port + LEVEL]
    if register == BSRR:  # write-only
        return 0
    return S[GPIO + GPIO_STRIDE * port + register]


@njit(cache=True)
def _lock(S: State, port: int, value: int) -> None:
    """LCKR written: 1, 0, 1 in LCKK with the same pins each time locks them until reset (section 8.4.8)."""
    register, step = GPIO + GPIO_STRIDE * port + LCKR, GPIO_PINS + GPIO_PINS_STRIDE * port + LOCK_STEP
    if S[register] & LCKK:
        return
    same, key = value & 0xFFFF == S[register], value & LCKK != 0
    if same and key and S[step] == 2:
        S[register] = value
    else:
        S[step] = 2 if same and not key and S[step] == 1 else int(key)
        S[register] = value & 0xFFFF


@njit("int64(int64[::1], int64, int64)", cache=True)
def _writable(S: State, port: int, bits: int) -> int:
    """The bits of a configuration register, `bits` for each pin, whose pins are not locked."""
    lock = S[GPIO + GPIO_STRIDE * port + LCKR]
    mask = 0
    for pin in range(16):
        if not (lock & LCKK and lock >> pin & 1):
            mask |= ((1 << bits) - 1) << (bits * pin)
    return mask


@njit(cache=True)
def write(S: State, offset: int, value: int) -> bool:
    """Write the register at `offset`; False if it is not modelled."""
    port, register = offset // 0x400, (offset % 0x400) // 4
    at = GPIO + GPIO_STRIDE * port
    if register == BSRR:  # set in the low half wins over reset in the high half
        S[at + ODR] = S[at + ODR] & ~(value >> 16) | value & 0xFFFF
    elif register == ODR:
        S[at + ODR] = value & 0xFFFF
    elif register == LCKR:
        _lock(S, port, value)
    elif register in (MODER, OSPEEDR, PUPDR, OTYPER):
        free = _writable(S, port, 1 if register == OTYPER else 2)
        S[at + register] = S[at + register] & ~free | value & free
    elif register in (AFRL, AFRH):
        free = _writable(S, port, 4) >> (32 * (register - AFRL)) & 0xFFFFFFFF
        S[at + register] = S[at + register] & ~free | value & free
    else:  # IDR is read-only
        return register == IDR
    if register not in (ODR, BSRR):
        _configure(S, port)
    settle(S, port, now_cycles(S))
    return True
