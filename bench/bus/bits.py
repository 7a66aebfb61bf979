"""The exact length of classic CAN data frames in bits, one or many (ISO 11898-1:2015).

Belongs here: lengths, and their bounds. Never: time, nodes, a queue; the bits (targets.frame_bits).
"""

from targets.frame_bits import length_bits

INTERMISSION_BITS = 3
"""Between two frames (clause 10.4.6); no part of a frame's length."""


def frame_bits(identifier: int, data: bytes, extended: bool = False) -> int:
    """Bits from start of frame to end of frame of one data frame, without the intermission."""
    length = len(data)
    word = int.from_bytes(data, "big") << (64 - 8 * length)
    return length_bits(identifier, extended, False, length, word >> 32, word & 0xFFFFFFFF)
