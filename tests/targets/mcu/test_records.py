"""Rings of records."""

from hypothesis import given
from hypothesis import strategies as st

from targets.mcu import records
from targets.mcu.state import RING_STRIDE, RINGS, allocate

RING = records.INPUT


def ring():
    """A state with its rings, the first input ring cut to 16 records."""
    S = allocate()
    memory = records.attach(S)
    S[RINGS + RING_STRIDE * RING + 1] = 16
    return S, memory


@given(values=st.lists(st.integers(-(2**63), 2**63 - 1), max_size=40))
def test_ring_keeps_the_newest(values):
    """The last sixteen records come back in order, and the others are counted."""
    S, _memory = ring()
    for value in values:
        records.append(S, RING, (value,))
    assert records.kept(S, RING)[:, 0].tolist() == values[-16:]
    assert records.lost(S, RING) == max(0, len(values) - 16)


@given(batches=st.lists(st.integers(0, 16), max_size=10))
def test_records_are_taken_in_order(batches):
    """What is appended is taken once, first come first served."""
    S, _memory = ring()
    put = taken = 0
    for count in batches:
        for _ in range(min(count, records.room(S, RING))):
            records.append(S, RING, (put,))
            put += 1
        while records.waiting(S, RING) > count // 2:
            assert records.take(S, RING) == taken
            taken += 1
    assert records.waiting(S, RING) == put - taken
    assert records.room(S, RING) == 16 - (put - taken)


def test_rings_do_not_touch():
    """A full ring leaves its neighbours alone."""
    S, _memory = ring()
    for k in range(100):
        records.append(S, RING, (k,))
    assert [len(records.kept(S, k)) for k in range(records.COUNT) if k != RING] == [0] * (records.COUNT - 1)


def test_state_without_memory_only_counts():
    """Without rings attached a record is counted and nothing is written."""
    S = allocate()
    before = S.copy()
    records.append(S, records.EDGES, (1, 2, 3, 4, 5))
    before[RINGS + 3] = 1
    assert (before == S).all()
