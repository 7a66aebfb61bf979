"""Alive counters: frames that never came, frames that came twice."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from bench.monitor.counters import SILENCE_NS, AliveCounter

MS = 1_000_000


def fed(counts, gaps_ms=None, cuts=()):
    """A 4-bit counter that was fed `counts` in pieces cut at `cuts`."""
    counter = AliveCounter(4)
    t_ns = np.cumsum(np.full(len(counts), 10) if gaps_ms is None else np.array(gaps_ms)) * MS
    for t, c in zip(np.split(t_ns, sorted(cuts)), np.split(np.array(counts), sorted(cuts)), strict=True):
        counter.feed(t, c)
    return counter.lost, counter.repeats, counter.restarts


def test_counting_up():
    """A counter that goes up by one, and wraps, is right."""
    assert fed([k % 16 for k in range(100)]) == (0, 0, 0)


def test_nothing():
    """No frame, and a first frame whatever its count, are no errors."""
    assert fed([]) == (0, 0, 0)
    assert fed([11]) == (0, 0, 0)


def test_gaps_and_repeats():
    """Each missing count is a frame lost; the same count again is a repeat, not fifteen losses."""
    assert fed([14, 15, 1, 2, 2, 3, 7]) == (4, 1, 0)


def test_restart():
    """After a silence of half a second the counter begins anew: neither a gap nor a repeat."""
    assert fed([3, 4, 12, 12], [10, 10, SILENCE_NS // MS, SILENCE_NS // MS]) == (0, 0, 2)
    assert fed([3, 4, 12], [10, 10, SILENCE_NS // MS - 1]) == (7, 0, 0)


@given(st.data())
def test_dropped_frames_are_counted(data):
    """Frames left out of a steady stream, fewer than 15 on end, are counted, however the stream is cut."""
    runs = data.draw(st.lists(st.tuples(st.integers(1, 20), st.integers(0, 14)), max_size=20))
    counts, next_count, lost = [], 0, 0
    for heard, dropped in runs:
        counts += [(next_count + k) % 16 for k in range(heard)]
        next_count += heard + dropped
        lost += dropped
    counts.append(next_count % 16)
    cuts = data.draw(st.lists(st.integers(0, len(counts)), max_size=5))
    assert fed(counts, cuts=cuts) == (lost, 0, 0)
