"""A classic CAN frame on the wire, bit by bit, stuff bits included (ISO 11898-1:2015).

Belongs here: the frame's bit sequence, its CRC and its stuffing. Never: time, nodes, a queue.

Stuffed, clause 10.5: start of frame, identifier, RTR (with SRR and IDE), IDE, reserved bits, DLC, data, CRC.
Not stuffed: CRC delimiter, ACK slot and delimiter, seven bits of end of frame.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from targets.jit import njit

TAIL_BITS = 10
"""CRC delimiter, ACK slot, ACK delimiter and end of frame: always sent as they are."""

MOST_BITS = 160
"""No classic frame is longer: 128 bits unstuffed (29-bit identifier, 8 bytes) and up to 29 stuff bits."""

LENGTH_AT, EXTENDED_AT, REMOTE_AT = 32, 36, 37
"""Bit numbers in `length_bits`' first argument."""

_CRC_POLYNOMIAL = 0x4599


@njit(cache=True)
def _crc_after(crc: int, bit: int) -> int:
    """Clause 10.4.2.6: the shift register after one more unstuffed bit."""
    shifted = (crc << 1) & 0x7FFF
    return shifted ^ _CRC_POLYNOMIAL if bit ^ ((crc >> 14) & 1) else shifted


@njit(cache=True)
def _encode(identifier, extended, remote, length, data, out):  # type: ignore[no-untyped-def]  # signatures below
    # header: start of frame to DLC, its first bit uppermost
    if extended:
        # SOF 0, base 11, SRR 1, IDE 1, extension 18, RTR, r1 0, r0 0, DLC 4
        base, extension = identifier >> 18, identifier & 0x3FFFF
        header = (((((base << 2) | 3) << 18) | extension) << 7) | remote << 6 | length
        header_bits = 39
    else:
        # SOF 0, identifier 11, RTR, IDE 0, r0 0, DLC 4
        header = (identifier << 7) | remote << 6 | length
        header_bits = 19
    crc = 0
    count = 0
    last = -1
    run = 0
    # a remote frame has a length, and no data
    total = header_bits if remote else header_bits + 8 * length
    for k in range(total + 15):
        if k < header_bits:
            bit = (header >> (header_bits - 1 - k)) & 1
        elif k < total:
            bit = (data >> (63 - (k - header_bits))) & 1
        else:
            bit = (crc >> (14 - (k - total))) & 1
        if k < total:
            crc = _crc_after(crc, bit)
        if out is not None:
            out[count] = bit
        count += 1
        run = run + 1 if bit == last else 1
        last = bit
        if run == 5:
            # the stuff bit is of the other value and opens the next run; one is due after the CRC's end too
            last = 1 - bit
            if out is not None:
                out[count] = last
            count += 1
            run = 1
    if out is not None:
        out[count : count + TAIL_BITS] = 1
    return count + TAIL_BITS


@njit("int64(int64, int64)", cache=True)
def length_bits(head: int, data: int) -> int:
    """Bits from start to end of frame; two numbers, since every argument costs its time.

    head: identifier, length << LENGTH_AT, extended << EXTENDED_AT, remote << REMOTE_AT. data: its eight
    bytes, big-endian, as a signed number.
    """
    extended, remote = head >> EXTENDED_AT & 1 != 0, head >> REMOTE_AT & 1
    return _encode(head & 0x1FFFFFFF, extended, remote, head >> LENGTH_AT & 0xF, data, None)


def stream(identifier: int, data: bytes, extended: bool = False) -> NDArray[Any]:
    """The bits that a data frame's sender drives, uint8 (bits,): 0 dominant, 1 recessive (the ACK slot)."""
    word = int.from_bytes(data.ljust(8, b"\0"), "big", signed=True)
    out = np.empty(MOST_BITS, dtype=np.uint8)
    return out[: _encode(identifier, extended, 0, len(data), word, out)]


def crc_holds(bits: Sequence[int]) -> bool:
    """Whether the last 15 of a frame's unstuffed bits, start of frame to CRC, are the CRC of the others."""
    crc = 0
    for bit in bits:
        crc = _crc_after(crc, bit)
    return crc == 0  # what is divisible by the polynomial
