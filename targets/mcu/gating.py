"""Which bit of RCC's enable registers clocks which device (RM0090 sections 7.3.10 to 7.3.14).

A device without its clock reads as zero and ignores writes; what was accessed so is counted by device.
"""

import numpy as np

from targets.jit import njit
from targets.mcu.state import RCC_ENABLE, UNCLOCKED, State

AHB1, AHB2, AHB3, APB1, APB2 = 0, 1, 2, 4, 5
DEVICES = {
    **{0x40020000 + 0x400 * k: (f"GPIO{name}", AHB1, k) for k, name in enumerate("ABCDEFGHI")},
    0x40023000: ("CRC", AHB1, 12),
    **{0x40000000 + 0x400 * k: (f"TIM{k + 2}", APB1, k) for k in range(4)},
    0x40002C00: ("WWDG", APB1, 11),
    **{0x40004400 + 0x400 * k: (name, APB1, 17 + k) for k, name in enumerate(("USART2", "USART3"))},
    **{0x40004C00 + 0x400 * k: (name, APB1, 19 + k) for k, name in enumerate(("UART4", "UART5"))},
    0x40006400: ("CAN1", APB1, 25),
    0x40006800: ("CAN2", APB1, 26),
    0x40007000: ("PWR", APB1, 28),
    0x40011000: ("USART1", APB2, 4),
    0x40011400: ("USART6", APB2, 5),
    0x40013800: ("SYSCFG", APB2, 14),
}
"""Base address -> name, enable register, bit. Devices that no other part of the emulator models are left out:
an access to them is counted by address in any case."""

_ORIGIN, _PAGES, _ALWAYS = 0x40000000, 512, -1


def _bits() -> "np.ndarray[tuple[int], np.dtype[np.int64]]":
    """32 times the register plus the bit for each kilobyte of the peripherals' region."""
    bits = np.full(_PAGES, _ALWAYS, dtype=np.int64)
    for base, (_, register, bit) in DEVICES.items():
        bits[(base - _ORIGIN) >> 10] = 32 * register + bit
    return bits


_BITS = _bits()


@njit("boolean(int64[::1], int64, int64)", cache=True)
def is_on(S: State, register: int, bit: int) -> bool:
    """Whether the enable bit is set."""
    return S[RCC_ENABLE + register] >> bit & 1 == 1


@njit(cache=True)
def answers(S: State, address: int) -> bool:
    """Whether the device at a peripheral address has its clock; an access without it is counted."""
    page = (address - _ORIGIN) >> 10
    if page < 0 or page >= _PAGES or _BITS[page] == _ALWAYS:
        return True
    if is_on(S, _BITS[page] >> 5, _BITS[page] & 31):
        return True
    S[UNCLOCKED + _BITS[page]] += 1
    return False


def unclocked(S: State) -> dict[str, int]:
    """Devices that were used without their clock: name -> times."""
    counts = {name: int(S[UNCLOCKED + 32 * register + bit]) for name, register, bit in DEVICES.values()}
    return {name: times for name, times in counts.items() if times}
