"""The exact length of classic CAN data frames in bits, one or many (ISO 11898-1:2015).

Belongs here: lengths, and their bounds. Never: time, nodes, a queue; the bits (targets.frame_bits).
"""

import numpy as np
from numpy.typing import NDArray

from targets.frame_bits import length_bits
from targets.jit import njit

INTERMISSION_BITS = 3
"""Between two frames (clause 10.4.6); no part of a frame's length."""


@njit(
    "int64[::1](int64[::1], boolean[::1], int64[::1], uint8[:, ::1])",
    cache=True,
)
def _bits_of_all(identifiers, extended, lengths, payload):  # type: ignore[no-untyped-def]  # signature above
    counts = np.empty(len(identifiers), dtype=np.int64)
    for k in range(len(identifiers)):
        high, low = np.int64(0), np.int64(0)
        for byte in range(min(lengths[k], payload.shape[1])):
            if byte < 4:
                high |= np.int64(payload[k, byte]) << (24 - 8 * byte)
            else:
                low |= np.int64(payload[k, byte]) << (56 - 8 * byte)
        counts[k] = length_bits(identifiers[k], extended[k], False, lengths[k], high, low)
    return counts


def frame_bits(identifier: int, data: bytes, extended: bool = False) -> int:
    """Bits from start of frame to end of frame of one data frame, without the intermission."""
    length = len(data)
    word = int.from_bytes(data, "big") << (64 - 8 * length)
    return length_bits(identifier, extended, False, length, word >> 32, word & 0xFFFFFFFF)


def frames_bits(
    identifiers: NDArray[np.integer],
    payload: NDArray[np.uint8],
    lengths: NDArray[np.integer] | None = None,
    extended: NDArray[np.bool_] | None = None,
) -> NDArray[np.int64]:
    """Bits of many frames, int64 (frames,): `frame_bits` of each.

    identifiers: integers (frames,). payload: uint8 (frames, bytes). lengths: data bytes of each frame, all of
    `payload`'s columns if None. extended: bool (frames,), none if None.
    """
    frames = len(identifiers)
    if lengths is None:
        lengths = np.full(frames, payload.shape[1])
    if extended is None:
        extended = np.zeros(frames, dtype=np.bool_)
    return _bits_of_all(
        np.ascontiguousarray(identifiers, dtype=np.int64),
        np.ascontiguousarray(extended, dtype=np.bool_),
        np.ascontiguousarray(lengths, dtype=np.int64),
        np.ascontiguousarray(payload, dtype=np.uint8),
    )


def shortest_bits(length: int, extended: bool = False) -> int:
    """Bits of a frame of `length` data bytes that needs no stuff bit: 8n + 44, or 8n + 64 if extended."""
    return 8 * length + (64 if extended else 44)


def longest_bits(length: int, extended: bool = False) -> int:
    """Bits of a frame that needs a stuff bit after every fourth bit: floor((34 + 8n - 1) / 4) more, or 54."""
    return shortest_bits(length, extended) + ((54 if extended else 34) + 8 * length - 1) // 4
