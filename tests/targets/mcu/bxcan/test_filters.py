"""Filter banks: modes, scale, numbering, priority, protection (RM0090 sections 32.7.4 and 32.9.4)."""

from types import SimpleNamespace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from targets.mcu.state import CAN_LOST, RCC_ENABLE
from tests.targets.mcu.bxcan.registers import (
    F0R1,
    FA1R,
    FFA1R,
    FIFO,
    FM1R,
    FMR,
    FS1R,
    RDTR,
    RF0R,
    RF1R,
    Can,
    rir,
)

CAN2EN = 1 << 26
MASK32, LIST32, MASK16, LIST16 = "mask32", "list32", "mask16", "list16"


def short(identifier, extended=False, remote=False):
    """An identifier as 16-bit filters see it: STID, RTR, IDE, EXID[17:15]."""
    base = identifier >> 18 if extended else identifier
    return base << 5 | remote << 4 | extended << 3 | (identifier >> 15 & 7 if extended else 0)


def bank(number, mode, one=0, two=0, fifo=0, active=True):
    return SimpleNamespace(number=number, mode=mode, one=one, two=two, fifo=fifo, active=active)


def configure(can, banks, start=14):
    """Write these banks through CAN1's registers; CAN2's begin at `start`."""
    can[FMR] = start << 8 | 1
    for register, bits in (
        (FS1R, [b.number for b in banks if b.mode in (MASK32, LIST32)]),
        (FM1R, [b.number for b in banks if b.mode in (LIST32, LIST16)]),
        (FFA1R, [b.number for b in banks if b.fifo]),
        (FA1R, [b.number for b in banks if b.active]),
    ):
        can[register] = sum(1 << number for number in bits)
    for b in banks:
        can[F0R1 + 8 * b.number] = b.one
        can[F0R1 + 8 * b.number + 4] = b.two
    can[FMR] = start << 8


def taken(can, identifier, extended=False, remote=False):
    """FIFO and filter match index of a frame, None if no filter let it in; the FIFO is emptied again."""
    assert can.arrives(identifier, extended=extended, remote=remote)
    for fifo, register in enumerate((RF0R, RF1R)):
        if can[register] & 3:
            index = can[RDTR + FIFO * fifo] >> 8 & 0xFF
            can[register] = 0x20
            return fifo, index
    return None


@pytest.fixture
def can():
    return Can().configured()


def test_without_filter_nothing_is_received(can):
    """With no bank active every message is discarded."""
    can.arrives(0x100)
    assert can[RF0R] & 3 == 0
    assert can.S[CAN_LOST] == 1


@pytest.mark.parametrize(
    ("mode", "one", "two", "lets_in", "keeps_out"),
    [
        (MASK32, rir(0x100), rir(0x7F0), (0x100, 0x10F), (0x110, 0x500)),
        (LIST32, rir(0x100), rir(0x101), (0x100, 0x101), (0x102, 0x000)),
        (
            MASK16,
            short(0x7F0) << 16 | short(0x100),
            short(0x7FF) << 16 | short(0x200),
            (0x10A, 0x200),
            (0x110, 0x201),
        ),
        (
            LIST16,
            short(0x300) << 16 | short(0x100),
            short(0x302) << 16 | short(0x301),
            (0x100, 0x300, 0x301, 0x302),
            (0x101, 0x303),
        ),
    ],
    ids=[MASK32, LIST32, MASK16, LIST16],
)
def test_filter_modes(can, mode, one, two, lets_in, keeps_out):
    """Each of the four filter modes lets in what it names and nothing else."""
    configure(can, [bank(5, mode, one, two)])
    assert [taken(can, identifier) is not None for identifier in lets_in] == [True] * len(lets_in)
    assert [taken(can, identifier) for identifier in keeps_out] == [None] * len(keeps_out)


def test_filters_see_identifier_extension_and_remote_bit(can):
    """The same number in an extended or a remote frame is another identifier."""
    configure(
        can,
        [bank(0, LIST32, rir(0x123), rir(0x123)), bank(1, MASK16, 8 << 16 | 8, 8 << 16 | 8, fifo=1)],
    )
    assert taken(can, 0x123) == (0, 0)
    assert taken(can, 0x123, remote=True) is None
    assert taken(can, 0x123, extended=True) == (1, 0), "the mask compares IDE alone"


def test_filter_numbering_of_figure_343(can):
    """The match index counts the filters of a FIFO's banks, deactivated ones too: the manual's example."""
    modes = [LIST32, MASK32, MASK16, LIST16, LIST32, LIST32, MASK16, MASK16, MASK16, LIST32, LIST16, LIST32]
    modes += [MASK32, MASK32]
    in_fifo_1, deactivated = {2, 4, 7, 8, 10, 11, 12}, {5, 7, 10}
    numbers = {
        0: {0: 0, 1: 2, 3: 3, 5: 7, 6: 9, 9: 11, 13: 13},
        1: {2: 0, 4: 2, 7: 4, 8: 6, 10: 8, 11: 12, 12: 14},
    }
    for target in range(14):
        if target in deactivated:
            continue
        # only the bank in question lets 0x155 in
        banks = []
        for number, mode in enumerate(modes):
            wide = mode in (MASK32, LIST32)
            this, other = (rir(0x155), rir(0x2AA)) if wide else (short(0x155), short(0x2AA))
            one = this if number == target else other
            if mode == MASK32:
                content = (one, 0xFFFFFFFE)
            elif mode == MASK16:
                content = (0xFFFF << 16 | one, 0xFFFF << 16 | other)
            elif mode == LIST32:
                content = (one, other)
            else:
                content = (other << 16 | one, other << 16 | other)
            banks.append(
                bank(number, mode, *content, fifo=int(number in in_fifo_1), active=number not in deactivated)
            )
        configure(can, banks)
        fifo = int(target in in_fifo_1)
        assert taken(can, 0x155) == (fifo, numbers[fifo][target])


def test_filter_priority(can):
    """32 bits before 16, then list before mask, then the lower number; the winner's FIFO gets the message."""
    everything16, exact16 = (0, 0), (short(0x100), short(0x100))
    ranked = [
        bank(3, LIST32, rir(0x100), rir(0x100), fifo=1),
        bank(2, MASK32, 0, 0),
        bank(1, LIST16, *exact16, fifo=1),
        bank(0, MASK16, *everything16),
    ]
    for first in range(4):
        configure(can, ranked[first:])
        banks = {b.number: b for b in ranked[first:]}
        winner = ranked[first]
        ahead = [b for number, b in banks.items() if number < winner.number and b.fifo == winner.fifo]
        sizes = {MASK32: 1, LIST32: 2, MASK16: 2, LIST16: 4}
        # banks that are not configured are 16-bit mask filters of FIFO 0
        blank = 0 if winner.fifo else sum(2 for number in range(winner.number) if number not in banks)
        assert taken(can, 0x100) == (winner.fifo, sum(sizes[b.mode] for b in ahead) + blank)
    configure(can, [bank(4, MASK32, 0, 0), bank(6, MASK32, 0, 0, fifo=1)])
    assert taken(can, 0x100)[0] == 0


def reference(banks, identifier, extended, remote):
    """FIFO and match index by the manual's text: every filter written out, the best of those that pass."""
    best = None
    number = {0: 0, 1: 0}
    wide_id, short_id = rir(identifier, extended, remote), short(identifier, extended, remote)
    for b in banks:
        halves = [b.one & 0xFFFF, b.one >> 16, b.two & 0xFFFF, b.two >> 16]
        passes = {
            MASK32: [(wide_id & b.two & ~1) == (b.one & b.two & ~1)],
            LIST32: [wide_id == b.one & ~1, wide_id == b.two & ~1],
            MASK16: [(short_id & m) == (i & m) for i, m in (halves[:2], halves[2:])],
            LIST16: [short_id == half for half in halves],
        }[b.mode]
        for hit in passes:
            rank = ([LIST32, MASK32, LIST16, MASK16].index(b.mode), b.number, number[b.fifo])
            if hit and b.active and (best is None or rank < best[0]):
                best = rank, (b.fifo, number[b.fifo])
            number[b.fifo] += 1
    return best[1] if best else None


# few values, so that filters do match, and one another, too
identifiers = st.sampled_from((0, 1, 0x100, 0x101, 0x7FF, 0x40000, 0x4000000, 0x4008000, 0x1FFFFFFF))
frames = st.tuples(identifiers, st.booleans(), st.booleans()).map(
    lambda frame: (frame[0] if frame[1] else frame[0] & 0x7FF, frame[1], frame[2])
)
words = st.one_of(
    frames.map(lambda frame: rir(*frame)),
    st.tuples(frames, frames).map(lambda pair: short(*pair[0]) << 16 | short(*pair[1])),
    st.sampled_from((0, 0xFFFFFFFF, 0xFFE00000, 0x00000006, 0xFFFF0000, 0x00180018)),
    st.integers(0, 0xFFFFFFFF),
)
contents = st.tuples(
    st.sampled_from((MASK32, LIST32, MASK16, LIST16)), words, words, st.integers(0, 1), st.booleans()
)


@settings(max_examples=200)
@given(st.lists(contents, min_size=14, max_size=14), st.lists(frames, min_size=1, max_size=6))
def test_filters_against_a_reference(banks, seen):
    """Whatever is in the banks, a message lands where the manual's rules, written out, put it."""
    can = Can().configured()
    banks = [bank(number, *content) for number, content in enumerate(banks)]
    configure(can, banks)
    for frame in seen:
        assert taken(can, *frame) == reference(banks, *frame)


def test_filter_initialisation_stops_reception(can):
    """While FINIT is set no message is received."""
    configure(can, [bank(0, MASK32)])
    can[FMR] = 14 << 8 | 1
    assert taken(can, 0x100) is None
    can[FMR] = 14 << 8
    assert taken(can, 0x100) == (0, 0)


def test_filter_registers_are_protected(can):
    """Mode, scale and assignment take writes with FINIT only; an active bank's filters, too."""
    configure(can, [bank(0, MASK32, 5, 6)])
    for register in (FM1R, FS1R, FFA1R, F0R1, F0R1 + 4):
        before = can[register]
        can[register] = 0x3F0
        assert can[register] == before
    can[F0R1 + 8] = 7
    assert can[F0R1 + 8] == 7, "bank 1 is not active"
    can[FA1R] = 0
    can[F0R1] = 8
    assert can[F0R1] == 8
    can[FMR] = 14 << 8 | 1
    for register in (FM1R, FS1R, FFA1R, FA1R):
        can[register] = 0xFFFFFFFF
        assert can[register] == 0x0FFFFFFF
    can[F0R1] = 9
    assert can[F0R1] == 9


def test_filter_master_register(can):
    """FMR resets to initialisation with CAN2SB 14, and takes FINIT and CAN2SB only."""
    assert Can()[FMR] == 0x2A1C0E01
    can[FMR] = 0xFFFFFFFF
    assert can[FMR] == 0x2A1C3F01


def test_banks_are_shared_out_by_can2sb():
    """Banks below CAN2SB filter for CAN1, the others for CAN2, whose match index begins at 0 there."""
    can1 = Can().configured()
    can2 = Can(2, can1.S).configured()
    configure(
        can1, [bank(3, LIST32, rir(0x100), rir(0x100)), bank(10, LIST32, rir(0x200), rir(0x200))], start=10
    )
    assert taken(can1, 0x100) == (0, 6)
    assert taken(can1, 0x200) is None
    assert taken(can2, 0x100) is None
    assert taken(can2, 0x200) == (0, 0)


def test_all_banks_for_one_controller():
    """CAN2SB 28 gives all banks to CAN1; 0 gives them to CAN2, and to CAN1 only while CAN2 is not clocked."""
    can1 = Can().configured()
    can2 = Can(2, can1.S).configured()
    last = [bank(27, MASK32)]
    configure(can1, last, start=28)
    assert taken(can1, 0x100) is not None
    assert taken(can2, 0x100) is None
    configure(can1, last, start=0)
    assert taken(can2, 0x100) is not None
    assert taken(can1, 0x100) is not None
    can1.S[RCC_ENABLE + 4] |= CAN2EN
    assert taken(can1, 0x100) is None


def test_filter_registers_are_at_can1_only():
    """CAN2 has no filter registers of its own."""
    from targets.mcu import bxcan

    can2 = Can(2)
    assert bxcan.read(can2.S, 0x400 + FMR) == -1
    assert not bxcan.write(can2.S, 0x400 + FA1R, 1)
