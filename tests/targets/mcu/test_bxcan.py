"""bxCAN's registers, by RM0090's sections."""

import pytest

from targets.mcu import bxcan, rcc
from targets.mcu.state import (
    ATTEND,
    CAN_FIFO,
    CAN_FIFO_COUNT,
    CAN_LOST,
    CAN_MAILBOX,
    CAN_TX_NEW,
    CAN_TX_NS,
    HZ,
    allocate,
)

MCR, MSR, TSR, RF0R, IER, BTR = 0x00, 0x04, 0x08, 0x0C, 0x14, 0x1C
TI0R, RI0R = 0x180, 0x1B0
FMR, FM1R, FS1R, FFA1R, FA1R, F0R1 = 0x200, 0x204, 0x20C, 0x214, 0x21C, 0x240
RATE = 500_000


@pytest.fixture
def can():
    """bxCAN at 22 MHz and 500 kbit/s, in normal mode, no filter active."""
    S = allocate()
    S[HZ] = 22_000_000
    rcc.reset(S)
    bxcan.reset(S)
    bxcan.write(S, MCR, 1)
    bxcan.write(S, BTR, 1 | 15 << 16 | 4 << 20)
    bxcan.write(S, MCR, 0)
    return S


def open_filter(S, fifo=0):
    """One 32-bit mask filter that lets every frame in."""
    bxcan.write(S, FMR, 1)
    bxcan.write(S, FS1R, 1)
    bxcan.write(S, FFA1R, fifo)
    bxcan.write(S, FA1R, 1)
    bxcan.write(S, FMR, 0)


def arrive(S, identifier, data=0):
    return bxcan.receive(S, RATE, identifier << 21, 8, data, 0)


def test_reset_is_sleep():
    """After reset the controller sleeps and hears nothing (section 32.4.3)."""
    S = allocate()
    S[HZ] = 16_000_000
    bxcan.reset(S)
    assert bxcan.read(S, MSR) & 3 == 2
    assert not bxcan.on_bus(S)


def test_initialisation_is_acknowledged(can):
    """INRQ is answered by INAK, and leaving it clears INAK (section 32.4.1)."""
    bxcan.write(can, MCR, 1)
    assert bxcan.read(can, MSR) & 3 == 1
    bxcan.write(can, MCR, 0)
    assert bxcan.read(can, MSR) & 3 == 0


def test_bit_timing_is_locked_in_normal_mode(can):
    """BTR takes writes in initialisation mode only (section 32.9.2)."""
    bxcan.write(can, BTR, 7)
    assert bxcan.read(can, BTR) == 1 | 15 << 16 | 4 << 20


def test_bit_rate_follows_clock_and_timing(can):
    """22 MHz / 2 / (1 + 16 + 5) quanta are 500 kbit/s (section 32.7.7)."""
    assert bxcan.bitrate(can) == 500_000
    can[HZ] = 44_000_000
    assert bxcan.bitrate(can) == 1_000_000


def test_another_bit_rate_is_noticed(can):
    """A controller set to another rate than the bus's does not receive."""
    open_filter(can)
    can[HZ] = 44_000_000
    assert not arrive(can, 0x100)
    assert can[CAN_FIFO_COUNT] == 0


def test_without_filter_nothing_is_received(can):
    """With no bank active every frame is discarded (section 32.7.4)."""
    assert arrive(can, 0x100)
    assert can[CAN_FIFO_COUNT] == 0
    assert can[CAN_LOST] == 1


@pytest.mark.parametrize(
    ("wide", "listed", "one", "two", "lets_in", "keeps_out"),
    [
        (1, 0, 0x100 << 21, 0x7F0 << 21, (0x100, 0x10F), (0x110, 0x500)),
        (1, 1, 0x100 << 21, 0x101 << 21, (0x100, 0x101), (0x102, 0x000)),
        (0, 0, 0x7F0 << 21 | 0x100 << 5, 0x7FF << 21 | 0x200 << 5, (0x10A, 0x200), (0x110, 0x201)),
        (0, 1, 0x300 << 21 | 0x100 << 5, 0x302 << 21 | 0x301 << 5, (0x100, 0x300, 0x302), (0x101, 0x303)),
    ],
    ids=["mask32", "list32", "mask16", "list16"],
)
def test_filter_modes(can, wide, listed, one, two, lets_in, keeps_out):
    """Each of the four filter modes lets in what it names and nothing else (section 32.7.4)."""
    bank = 5
    bxcan.write(can, FMR, 1)
    bxcan.write(can, FS1R, wide << bank)
    bxcan.write(can, FM1R, listed << bank)
    bxcan.write(can, F0R1 + 8 * bank, one)
    bxcan.write(can, F0R1 + 8 * bank + 4, two)
    bxcan.write(can, FA1R, 1 << bank)
    bxcan.write(can, FMR, 0)
    for identifier in lets_in:
        before = int(can[CAN_FIFO_COUNT])
        arrive(can, identifier)
        assert can[CAN_FIFO_COUNT] == before + 1
        bxcan.write(can, RF0R, 0x20)
    for identifier in keeps_out:
        arrive(can, identifier)
        assert can[CAN_FIFO_COUNT] == 0


def test_fifo_keeps_order_and_releases(can):
    """The output mailbox shows the oldest frame until RFOM releases it (section 32.7.3)."""
    open_filter(can)
    for identifier in (0x10, 0x11, 0x12):
        arrive(can, identifier)
    assert bxcan.read(can, RF0R) & 0xB == 3 | 8
    seen = []
    while bxcan.read(can, RF0R) & 3:
        seen.append(bxcan.read(can, RI0R) >> 21)
        bxcan.write(can, RF0R, 0x20)
    assert seen == [0x10, 0x11, 0x12]


def test_overrun_overwrites_the_last(can):
    """A fourth frame sets FOVR and replaces the newest, unless RFLM is set (section 32.7.3)."""
    open_filter(can)
    for identifier in (0x10, 0x11, 0x12, 0x13):
        arrive(can, identifier)
    assert bxcan.read(can, RF0R) & 0x10
    assert can[CAN_FIFO + 8] >> 21 == 0x13
    bxcan.write(can, MCR, 0x10)
    arrive(can, 0x14)
    assert can[CAN_FIFO + 8] >> 21 == 0x13


def test_second_fifo_by_filter_assignment(can):
    """FFA1R sends a bank's frames to FIFO 1 (section 32.9.4)."""
    open_filter(can, fifo=1)
    arrive(can, 0x10)
    assert can[CAN_FIFO_COUNT] == 0
    assert can[CAN_FIFO_COUNT + 1] == 1


def test_receive_line_needs_its_enable(can):
    """A pending message raises the line only with FMPIE0 (section 32.8)."""
    open_filter(can)
    arrive(can, 0x10)
    assert not bxcan.line(can, bxcan.RX0_IRQ)
    bxcan.write(can, IER, 2)
    assert bxcan.line(can, bxcan.RX0_IRQ)


def test_mailbox_request_and_completion(can):
    """TXRQ takes the mailbox until the frame is sent; then RQCP, TXOK and TME are set (section 32.7.1)."""
    bxcan.write(can, TI0R, 0x123 << 21 | 1)
    assert bxcan.read(can, TSR) >> 26 & 7 == 6
    assert bxcan.read(can, TSR) >> 24 & 3 == 1, "CODE names the next empty mailbox"
    assert can[CAN_TX_NEW] == 1
    assert can[ATTEND] == 1
    bxcan.write(can, TI0R, 0x456 << 21)
    assert can[CAN_MAILBOX] >> 21 == 0x123, "a pending mailbox is read-only"
    bxcan.sent(can, 0)
    assert bxcan.read(can, TSR) & 3 == 3
    assert bxcan.read(can, TSR) >> 26 & 7 == 7
    bxcan.write(can, TSR, 1)
    assert bxcan.read(can, TSR) & 3 == 0


def test_request_carries_its_instant(can):
    """A transmit request is stamped with the CPU's time."""
    can[16] = 22_000  # CYCLES: 1 ms at 22 MHz
    bxcan.write(can, TI0R, 1)
    assert can[CAN_TX_NS] == 1_000_000


def test_unknown_register_is_not_modelled(can):
    """A register that does not exist says so instead of taking the write."""
    assert not bxcan.write(can, 0x3F0, 1)
    assert bxcan.read(can, 0x3F0) == -1
