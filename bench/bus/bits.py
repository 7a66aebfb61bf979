"""The exact length of a classic CAN data frame in bits, stuff bits included (ISO 11898-1:2015).

Belongs here: the frame's bit sequence, its CRC and its stuffing. Never: time, nodes, a queue.

Stuffed, clause 10.5: start of frame, identifier, RTR (with SRR and IDE), IDE, reserved bits, DLC, data, CRC.
Not stuffed: CRC delimiter, ACK slot and delimiter, seven bits of end of frame.
"""

from targets.jit import njit

TAIL_BITS = 10
"""CRC delimiter, ACK slot, ACK delimiter and end of frame: always sent as they are."""

INTERMISSION_BITS = 3
"""Between two frames (clause 10.4.6); no part of a frame's length."""

_CRC_POLYNOMIAL = 0x4599


@njit("int64(int64, boolean, int64, int64, int64)", cache=True)
def _bits(identifier, extended, length, high, low):  # type: ignore[no-untyped-def]  # signature above
    # header: start of frame to DLC, its first bit uppermost
    if extended:
        # SOF 0, base 11, SRR 1, IDE 1, extension 18, RTR 0, r1 0, r0 0, DLC 4
        base, extension = identifier >> 18, identifier & 0x3FFFF
        header = (((((base << 2) | 3) << 18) | extension) << 7) | length
        header_bits = 39
    else:
        # SOF 0, identifier 11, RTR 0, IDE 0, r0 0, DLC 4
        header = (identifier << 7) | length
        header_bits = 19
    crc = 0
    count = 0
    last = -1
    run = 0
    total = header_bits + 8 * length
    for k in range(total + 15):
        if k < header_bits:
            bit = (header >> (header_bits - 1 - k)) & 1
        elif k < total:
            at = k - header_bits  # of 64 data bits, the upper 32 in `high`
            bit = (high >> (31 - at)) & 1 if at < 32 else (low >> (63 - at)) & 1
        else:
            bit = (crc >> (14 - (k - total))) & 1
        if k < total:
            # clause 10.4.2.6: shift register over the unstuffed bits
            feedback = bit ^ ((crc >> 14) & 1)
            crc = (crc << 1) & 0x7FFF
            if feedback:
                crc ^= _CRC_POLYNOMIAL
        count += 1
        run = run + 1 if bit == last else 1
        last = bit
        if run == 5:
            # the stuff bit is of the other value and opens the next run; one is due after the CRC's end too
            count += 1
            last = 1 - bit
            run = 1
    return count + TAIL_BITS


def frame_bits(identifier: int, data: bytes, extended: bool = False) -> int:
    """Bits from start of frame to end of frame of one data frame, without the intermission."""
    length = len(data)
    word = int.from_bytes(data, "big") << (64 - 8 * length)
    return _bits(identifier, extended, length, word >> 32, word & 0xFFFFFFFF)
