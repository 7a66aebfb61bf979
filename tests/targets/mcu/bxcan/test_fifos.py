"""Receive FIFOs (RM0090 section 32.7.3)."""

import pytest

from targets.mcu.state import CAN_LOST, HZ
from tests.targets.mcu.bxcan.registers import (
    BIT,
    FIFO,
    MCR,
    MSR,
    RDHR,
    RDLR,
    RDTR,
    RF0R,
    RF1R,
    RFLM,
    RIR,
    TTCM,
    Can,
    rir,
)

FMP, FULL, FOVR, RFOM = 3, 8, 0x10, 0x20


def arrive(can, *identifiers):
    for identifier in identifiers:
        can.starts()
        can.t_ns += 100 * BIT
        assert can.arrives(identifier)


def drain(can, register=RF0R, at=RIR):
    seen = []
    while can[register] & FMP:
        seen.append(can[at] >> 21)
        can[register] = RFOM
    return seen


def test_message_as_received(can):
    """The output mailbox shows identifier, length, filter match index and data of the message."""
    can.arrives(0x1ABCDEF0, b"12345", extended=True)
    assert can[RIR] == rir(0x1ABCDEF0, extended=True)
    assert can[RDTR] == 5
    assert (can[RDLR], can[RDHR]) == (0x34333231, 0x35)
    can[RF0R] = RFOM
    can.arrives(0x123, b"\xff" * 8)
    assert (can[RIR], can[RDTR], can[RDLR], can[RDHR]) == (rir(0x123), 8, 0xFFFFFFFF, 0xFFFFFFFF)


def test_fifo_keeps_order_and_releases(can):
    """Three messages are kept in order; RFOM releases the oldest, and does nothing to an empty FIFO."""
    arrive(can, 0x10, 0x11, 0x12)
    assert can[RF0R] & (FMP | FULL) == 3 | FULL
    assert drain(can) == [0x10, 0x11, 0x12]
    can[RF0R] = RFOM
    assert can[RF0R] & FMP == 0


def test_full_is_cleared_by_software_only(can):
    """FULL stays set when a message is released, until a one is written to it."""
    arrive(can, 0x10, 0x11, 0x12)
    can[RF0R] = RFOM
    assert can[RF0R] & (FMP | FULL) == 2 | FULL
    can[RF0R] = FULL
    assert can[RF0R] & (FMP | FULL) == 2


def test_overrun_overwrites_the_last_message(can):
    """Without RFLM a fourth message sets FOVR and takes the place of the third."""
    arrive(can, 0x10, 0x11, 0x12, 0x13, 0x14)
    assert can[RF0R] & (FMP | FOVR) == 3 | FOVR
    assert can.S[CAN_LOST] == 2
    can[RF0R] = FOVR
    assert can[RF0R] & FOVR == 0
    assert drain(can) == [0x10, 0x11, 0x14]


def test_overrun_of_a_locked_fifo_discards_the_newest(can):
    """With RFLM a fourth message sets FOVR and is lost."""
    can[MCR] = RFLM
    arrive(can, 0x10, 0x11, 0x12, 0x13)
    assert can[RF0R] & FOVR
    assert drain(can) == [0x10, 0x11, 0x12]


def test_second_fifo_by_filter_assignment(can):
    """FFA1R sends a bank's messages to FIFO 1, whose registers are its own."""
    can.open_filter(fifo=1)
    arrive(can, 0x10, 0x11)
    assert can[RF0R] & FMP == 0
    assert can[RF1R] & FMP == 2
    assert can[RIR + FIFO] == rir(0x10)
    assert drain(can, RF1R, RIR + FIFO) == [0x10, 0x11]


def test_release_reads_as_busy_for_a_moment(can):
    """RFOM reads as set for two clocks of APB1 after a release; FMP shows the new number at once."""
    arrive(can, 0x10, 0x11)
    can[RF0R] = RFOM
    assert can[RF0R] & (RFOM | FMP) == RFOM | 1
    can.S[16] += 2
    assert can[RF0R] & (RFOM | FMP) == 1


@pytest.mark.parametrize("announced", [True, False])
def test_time_stamp_of_a_reception(announced):
    """In time-triggered mode RDTxR holds the bit count at the start of frame, told by the bus or reckoned."""
    can = Can().configured(mcr=TTCM).open_filter()
    start, bits = 11 * BIT + 1_000 * BIT, 55  # of 0x555 with one byte 0x55: 52 bits and 3 of stuffing
    if announced:
        can.starts(t_ns=start)
    can.arrives(0x555, b"\x55", t_ns=start + bits * BIT)
    stamp = can[RDTR] >> 16
    assert stamp == 1_000 if announced else abs(stamp - 1_000) <= 3


def test_no_time_stamp_outside_time_triggered_mode(can):
    """Without TTCM the time stamp is 0."""
    can.t_ns = 10**8
    arrive(can, 0x10)
    assert can[RDTR] >> 16 == 0


def test_another_bit_rate_is_noticed(can):
    """A controller set to another rate than its bus receives nothing, and says why."""
    can.S[HZ] = 44_000_000
    assert not can.arrives(0x100)
    assert can[RF0R] & FMP == 0
    assert can[MSR] & (1 << 9) == 0


def test_frame_that_began_before_it_was_on_the_bus(reset):
    """A frame whose start was missed is not received when it ends."""
    reset.starts()
    reset[MCR] = 1
    reset.open_filter()
    reset.arrives(0x100)
    assert reset[RF0R] & FMP == 0
    assert reset.S[CAN_LOST] == 1
