"""Sums over the last second."""

from hypothesis import given
from hypothesis import strategies as st

from bench.monitor.window import LastSecond


@given(st.integers(1, 40), st.integers(1, 5))
def test_steady_rate(period, amount):
    """What comes evenly, so much every whole part of 50 ms, is reported exactly."""
    window = LastSecond()
    period_ns = 50_000_000 // period
    for k in range(60 * period):
        window.add(k // period * 50_000_000 + k % period * period_ns, amount)
    assert window.per_second(60 * 50_000_000) == 20 * period * amount


def test_before_the_first_second():
    """In the first second the sum counts over the time since 0, which is nothing in the first bin."""
    window = LastSecond()
    assert window.per_second(0) == 0
    for k in range(10):
        window.add(k * 10_000_000)
    assert window.per_second(49_000_000) == 0
    assert window.per_second(100_000_000) == 100


def test_silence():
    """A second after the last frame nothing is left."""
    window = LastSecond()
    window.add(10_000_000, 7)
    assert window.per_second(1_000_000_000) == 7
    assert window.per_second(1_050_000_000) == 0


def test_bounded():
    """However long it is used it holds a second's worth."""
    window = LastSecond()
    for k in range(100_000):
        window.add(k * 1_000_000)
    assert len(window._bins) <= 21
