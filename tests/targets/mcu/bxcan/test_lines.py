"""Interrupt lines (RM0090 section 32.8) and the second controller."""

import pytest

from targets.mcu import bxcan, lines
from tests.targets.mcu.bxcan.registers import BIT, IER, MCR, RF0R, RF1R, SLEEP, TIR, TSR, Can


@pytest.mark.parametrize("fifo", [0, 1])
@pytest.mark.parametrize(("flag", "frames"), [(0, 1), (1, 3), (2, 4)], ids=["FMPIE", "FFIE", "FOVIE"])
def test_receive_lines_need_their_enable(can, fifo, flag, frames):
    """Pending message, full FIFO and overrun raise their FIFO's line with their own enable bit only."""
    can.open_filter(fifo=fifo)
    for _ in range(frames):
        can.passes()
    can[IER] = 0x7E & ~(1 << 1 + 3 * fifo + flag) & ~(0x7 << 4 - 3 * fifo)
    others = can.line(1 + fifo)
    can[IER] = 1 << 1 + 3 * fifo + flag
    assert can.line(1 + fifo)
    assert not can.line(2 - fifo)
    can[IER] = 0
    assert not can.line(1 + fifo)
    assert others is (frames > 1)


def test_receive_line_falls_with_the_last_message(can):
    """The line stays up until the FIFO is empty."""
    can[IER] = 2
    can.passes()
    can.passes()
    can[RF0R] = 0x20
    assert can.line(1)
    can[RF0R] = 0x20
    assert not can.line(1)
    assert can[RF1R] & 3 == 0


@pytest.mark.parametrize("mailbox", [0, 1, 2])
def test_transmit_line(can, mailbox):
    """RQCP of any mailbox raises the transmit line with TMEIE, until it is cleared."""
    can.fill(mailbox, 0x123)
    can[IER] = 1
    assert not can.line(0)
    can.passes(mailbox)
    assert can.line(0)
    can[TSR] = 1 << 8 * mailbox
    assert not can.line(0)


@pytest.mark.parametrize(("enable", "wakes"), [(1 << 16, True), (1 << 15, False), (0, False)])
def test_wakeup_line_needs_its_enable(can, enable, wakes):
    """WKUI raises the status change line with WKUIE."""
    can[MCR] = SLEEP
    can[IER] = enable
    can.starts()
    assert can.line(3) is wakes


@pytest.mark.parametrize("number", [1, 2])
def test_interrupt_numbers(number):
    """CAN1 has interrupts 19 to 22, CAN2 63 to 66 (table 61); the other controller's lines stay down."""
    can = Can(number).configured()
    can[IER] = 1
    can.fill(0, 0x123)
    can.passes(0)
    up = [irq for irq in range(96) if lines.level(can.S, irq)]
    assert up == [19 if number == 1 else 63]


def test_second_controller_is_its_own():
    """CAN2's registers lie 0x400 behind CAN1's, and what happens to one leaves the other alone."""
    assert (bxcan.BASE, bxcan.SIZE) == (0x40006400, 0x800)
    can1 = Can().configured()
    can2 = Can(2, can1.S).configured()
    can2.fill(0, 0x123)
    can2.fails(0, tec=8)
    assert can2[TIR] != 0
    assert (can1[TIR], can1[TSR], can1.tec) == (0, 0x1C000000, 0)
    assert can2.tec == 8
    can2.t_ns += 11 * BIT
    can1[MCR] = 1 << 15
    assert can2.tec == 8
    assert can2.offers() == 0
