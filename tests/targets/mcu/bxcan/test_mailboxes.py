"""Transmit mailboxes: priority, outcome, abort (RM0090 sections 32.7.1 and 32.9.2)."""

from operator import itemgetter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from targets.mcu.state import ATTEND, CAN_TX_NEW, CAN_TX_NS, CAN_TX_ORDER
from tests.targets.mcu.bxcan.registers import (
    BIT,
    BTR,
    BTR_500K,
    INRQ,
    MAILBOX,
    MCR,
    NART,
    TDHR,
    TDLR,
    TDTR,
    TIR,
    TSR,
    TTCM,
    TXFP,
    Can,
    rir,
)

RQCP, TXOK, ALST, TERR, ABRQ = 1, 2, 4, 8, 0x80
TGT = 1 << 8


def outcome(can, mailbox):
    """RQCP, TXOK, ALST, TERR and ABRQ of a mailbox, and whether it is empty."""
    tsr = can[TSR]
    return tsr >> 8 * mailbox & 0xFF, tsr >> 26 + mailbox & 1


def order_of_sending(can):
    """Mailboxes in the order in which the bus gets them."""
    order = []
    while (mailbox := can.offers()) >= 0:
        order.append(mailbox)
        can.passes(mailbox)
        can.t_ns += 3 * BIT
    return order


def test_request_takes_the_mailbox_until_it_is_sent(can):
    """TXRQ clears TME; a frame that ended well sets RQCP, TXOK and TME and clears TXRQ."""
    can.fill(0, 0x123)
    assert outcome(can, 0) == (0, 0)
    assert can.S[CAN_TX_NEW] == 1
    assert can.S[ATTEND] == 1
    can.passes(0)
    assert outcome(can, 0) == (RQCP | TXOK, 1)
    assert can[TIR] == rir(0x123)


def test_request_carries_its_instant(can):
    """A transmit request is stamped with the CPU's time."""
    can.t_ns = 5_000_000
    can.fill(1, 0x123)
    assert can.S[CAN_TX_NS + 1] == 5_000_000


def test_pending_mailbox_is_locked(can):
    """While a mailbox is pending none of its registers takes a write."""
    can.fill(1, 0x123, b"12345678")
    for register in (TIR, TDTR, TDLR, TDHR):
        before = can[register + MAILBOX]
        can[register + MAILBOX] = 0x5550001
        assert can[register + MAILBOX] == before


def test_outcome_is_cleared_by_rqcp_or_a_new_request(can):
    """A one to RQCP clears the four status bits, a one to TXOK alone does not; so does a new request."""
    for mailbox in (0, 1):
        can.fill(mailbox, 0x123)
        can.passes(mailbox)
    can[TSR] = TXOK
    assert outcome(can, 0)[0] == RQCP | TXOK
    can[TSR] = RQCP
    assert outcome(can, 0)[0] == 0
    assert outcome(can, 1)[0] == RQCP | TXOK
    can.fill(1, 0x124)
    assert outcome(can, 1)[0] == 0


def arbitration(identifier, extended, remote):
    """The bits that a frame puts against others, as text: what sorts first wins."""
    if extended:
        return f"{identifier >> 18:011b}11{identifier & 0x3FFFF:018b}{int(remote)}"
    return f"{identifier:011b}{int(remote)}0"


frames = st.tuples(st.integers(0, 0x1FFFFFFF), st.booleans(), st.booleans()).map(
    lambda frame: (frame[0] if frame[1] else frame[0] & 0x7FF, frame[1], frame[2])
)


@given(st.permutations((0, 1, 2)), st.lists(frames, min_size=3, max_size=3), st.booleans())
def test_priority_by_identifier(order, content, alike):
    """The lowest identifier goes first, as arbitration has it; of equal ones the lowest mailbox."""
    can = Can().configured()
    if alike:
        content[order[2]] = content[order[0]]
    for mailbox in order:
        identifier, extended, remote = content[mailbox]
        can.fill(mailbox, identifier, b"", extended, remote)
    expected = sorted(range(3), key=lambda mailbox: (arbitration(*content[mailbox]), mailbox))
    assert order_of_sending(can) == expected


@given(st.permutations((0, 1, 2)), st.lists(st.integers(0, 0x7FF), min_size=3, max_size=3))
def test_priority_by_order_of_request(order, identifiers):
    """With TXFP the mailboxes are sent in the order of their requests."""
    can = Can().configured(mcr=TXFP)
    for mailbox in order:
        can.fill(mailbox, identifiers[mailbox])
    assert order_of_sending(can) == list(order)


def test_more_urgent_request_goes_before_a_waiting_one(can):
    """A mailbox that is only scheduled gives way to a later one of higher priority."""
    can.fill(0, 0x300)
    can.starts()
    can.fill(1, 0x200)
    can.arrives(0x100)
    assert order_of_sending(can) == [1, 0]


@given(st.permutations((0, 1, 2)), st.lists(st.integers(0, 0x7FF), min_size=3, max_size=3, unique=True))
def test_code_and_lowest_priority(order, identifiers):
    """CODE names the next empty mailbox, with none empty the one sent last, which LOW marks from two on."""
    can = Can().configured()
    assert can[TSR] >> 24 & 3 == 0
    pending = []
    for mailbox in order:
        can.fill(mailbox, identifiers[mailbox])
        pending.append((identifiers[mailbox], mailbox))
        last = max(pending, key=itemgetter(0))[1]
        empty = [number for number in range(3) if number not in order[: len(pending)]]
        assert can[TSR] >> 24 & 3 == (empty[0] if empty else last)
        assert can[TSR] >> 29 == (1 << last if len(pending) > 1 else 0)


def test_failed_frame_is_repeated(can):
    """Without NART an error leaves the mailbox pending with TERR, a lost arbitration with ALST."""
    can.fill(0, 0x123)
    can.fails(0, tec=8)
    assert outcome(can, 0) == (TERR, 0)
    assert can.offers() == 0
    can.starts()
    from targets.mcu.bxcan import node

    node.lost(can.S, can.c, 0)
    assert outcome(can, 0) == (ALST, 0)
    can.arrives(0x100)
    can.passes(0)
    assert outcome(can, 0) == (RQCP | TXOK, 1)


@pytest.mark.parametrize("cause", [ALST, TERR])
def test_no_automatic_retransmission(cause):
    """With NART the first attempt is the last: RQCP without TXOK, and the cause."""
    from targets.mcu.bxcan import node

    can = Can().configured(mcr=NART)
    can.fill(0, 0x123)
    if cause == TERR:
        can.fails(0, tec=8)
    else:
        can.starts()
        node.lost(can.S, can.c, 0)
        can.arrives(0x100)
    assert outcome(can, 0) == (RQCP | cause, 1)
    assert can.offers() == -1


def test_abort_of_a_waiting_mailbox(can):
    """ABRQ empties a pending mailbox at once: RQCP without TXOK; on an empty one it has no effect."""
    can.fill(0, 0x123)
    can[TSR] = ABRQ
    assert outcome(can, 0) == (RQCP, 1)
    assert can.offers() == -1
    can[TSR] = RQCP | ABRQ << 8
    assert outcome(can, 0) == (0, 1)
    assert outcome(can, 1) == (0, 1)


@pytest.mark.parametrize("succeeds", [True, False])
def test_abort_on_the_wire_waits_for_the_end(can, succeeds):
    """ABRQ during the frame: it ends as sent with TXOK, or after an error it is not repeated."""
    can.fill(0, 0x123)
    can.starts(0)
    can[TSR] = ABRQ
    assert outcome(can, 0) == (ABRQ, 0)
    if succeeds:
        can.is_sent(0)
        assert outcome(can, 0) == (RQCP | TXOK, 1)
    else:
        can.errs(0, tec=8)
        can.is_free()
        assert outcome(can, 0) == (RQCP | TERR, 1)
    assert can.offers() == -1


def test_request_for_initialisation_holds_frames_back(can):
    """Between INRQ and INAK no further frame is started."""
    can.starts()
    can.fill(0, 0x123)
    can[MCR] = INRQ
    assert can.offers() == -1


def test_empty_mailbox_keeps_what_is_written(can):
    """Registers of an empty mailbox read back as written, TDTR without its reserved bits."""
    for register, value in ((TIR, 0xFFFFFFFE), (TDLR, 0x11223344), (TDHR, 0x55667788)):
        can[register] = value
        assert can[register] == value
    can[TDTR] = 0xFFFFFFFF
    assert can[TDTR] == 0xFFFF010F


def test_time_stamp_of_a_transmission():
    """In time-triggered mode TDTxR holds the bit count of its start of frame; otherwise 0."""
    for mcr in (0, TTCM):
        can = Can().configured(mcr=mcr)
        entered = 11 * BIT  # when INAK cleared
        can.fill(0, 0x123)
        can.t_ns = entered + 70_000 * BIT
        can.passes(0)
        assert can[TDTR] >> 16 == (70_000 - 65_536 if mcr else 0)


def test_time_stamp_in_the_last_two_bytes():
    """With TGT and eight bytes the stamp replaces bytes 6 (its upper half) and 7; not with seven."""
    from targets.mcu.bxcan import mailboxes

    can = Can().configured(mcr=TTCM)
    can.fill(0, 0x123, b"12345678", more=TGT)
    can.fill(1, 0x124, b"1234567", more=TGT)
    start = 11 * BIT + 0x1234 * BIT
    for mailbox, sent in ((0, b"56\x12\x34"), (1, b"567\0")):
        word = mailboxes.high_word(can.S, can.c, mailbox, start)
        assert int(word).to_bytes(4, "little") == sent


def test_requests_are_numbered(can):
    """Each request has a number of its own, whatever the mailbox: order survives equal instants."""
    for mailbox in (2, 0):
        can.fill(mailbox, 0x123)
    assert can.S[CAN_TX_ORDER + 2] < can.S[CAN_TX_ORDER]
    assert can.S[CAN_TX_NS + 2] == can.S[CAN_TX_NS]


def test_bit_rate_follows_clock_and_timing(can):
    """22 MHz / 2 / (1 + 16 + 5) quanta are 500 kbit/s, at twice the clock twice as much (section 32.7.7)."""
    from targets.mcu.bxcan import timing
    from targets.mcu.state import HZ

    assert can[BTR] == BTR_500K
    assert timing.bitrate(can.S, can.c) == 500_000
    can.S[HZ] = 44_000_000
    assert timing.bitrate(can.S, can.c) == 1_000_000
