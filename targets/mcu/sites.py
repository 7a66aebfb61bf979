"""Where in an image the instructions lie that the emulator must watch one by one.

Sought by their bits at every halfword of the code: a pair of halfwords that only looks like one is never
executed as one, and a watch on it never called.
"""

import numpy as np
from numpy.typing import NDArray

from targets.mcu.image import FLASH, Image


def divisions(image: Image) -> list[int]:
    """Addresses of SDIV and UDIV (ARMv7-M A7.7.127, A7.7.195)."""
    first, second, at = _pairs(image)
    return _addresses(at[((first & 0xFFD0) == 0xFB90) & ((second & 0xF0F0) == 0xF0F0)])


def send_events(image: Image) -> list[int]:
    """Addresses of SEV (A7.7.130), both encodings."""
    first, second, at = _pairs(image)
    return _addresses(at[(first == 0xBF40) | ((first == 0xF3AF) & (second == 0x8004))])


def fp(image: Image) -> list[int]:
    """Addresses of instructions for the FPU: of coprocessor 10 or 11 (A5.3.18)."""
    first, second, at = _pairs(image)
    return _addresses(at[((first & 0xEC00) == 0xEC00) & ((second & 0x0E00) == 0x0A00)])


def _pairs(image: Image) -> tuple[NDArray[np.uint16], NDArray[np.uint16], NDArray[np.int64]]:
    """Each halfword of the code, the one behind it, and its address."""
    halfwords = np.frombuffer(image.flash[: len(image.flash) & ~1], dtype="<u2")
    inside = np.zeros(len(halfwords), dtype=bool)
    for start, end in image.code:
        inside[(start - FLASH) // 2 : (end - FLASH) // 2] = True
    at = np.flatnonzero(inside)
    behind = np.append(halfwords[1:], np.uint16(0))
    return halfwords[at], behind[at], FLASH + 2 * at


def _addresses(at: NDArray[np.int64]) -> list[int]:
    return [int(address) for address in at]
