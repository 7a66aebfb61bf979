"""The exact length of a classic CAN data frame in bits, stuff bits included (ISO 11898-1:2015).

Belongs here: lengths. Never: time, nodes, a queue; the bits (targets.frame_bits).
"""

from targets.frame_bits import EXTENDED_AT, LENGTH_AT, length_bits

INTERMISSION_BITS = 3
"""Between two frames (clause 10.4.6); no part of a frame's length."""


def frame_bits(identifier: int, data: bytes, extended: bool = False) -> int:
    """Bits from start of frame to end of frame of one data frame, without the intermission."""
    word = int.from_bytes(data.ljust(8, b"\0"), "big", signed=True)
    return length_bits(identifier | len(data) << LENGTH_AT | extended << EXTENDED_AT, word)
