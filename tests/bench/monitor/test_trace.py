"""The recent past of a message's signals."""

import numpy as np
import pytest

from bench.monitor.trace import BIN_NS, BINS, Trace
from tests.bench.monitor.conftest import MS


@pytest.fixture
def trace(codec):
    return Trace(codec, codec.message("STROKES"))


def fed(trace, frame, times_ns, values):
    for k, (t_ns, value) in enumerate(zip(times_ns, values, strict=True)):
        trace.add(t_ns, frame("STROKES", rear_stroke_mm=value, alive=k % 16).data)


def test_nothing_yet(trace):
    """Before the first frame there is no value, no span and no mean."""
    trace.fold(0)
    assert trace.last == {}
    assert np.isnan(trace.span("rear_stroke_mm")).all()
    assert np.isnan(trace.means("rear_stroke_mm")).all()


def test_values(trace, frame):
    """The latest value, the lowest and the highest, and each bin's mean, within half a code."""
    fed(trace, frame, [0, 10 * MS, 60 * MS], [10.0, 20.0, 90.0])
    trace.fold(60 * MS)
    half = 0.0269 / 2
    assert trace.last["rear_stroke_mm"] == pytest.approx(90, abs=half)
    assert trace.span("rear_stroke_mm") == pytest.approx((10, 90), abs=half)
    means = trace.means("rear_stroke_mm")
    assert means[-2:] == pytest.approx([15, 90], abs=half)
    assert np.isnan(means[:-2]).all()


def test_forgets(trace, frame):
    """What is older than the time remembered is gone; the latest value stays."""
    fed(trace, frame, [0, BIN_NS], [10.0, 50.0])
    trace.fold(BINS * BIN_NS)
    assert trace.span("rear_stroke_mm") == pytest.approx((50, 50), abs=0.02)
    trace.fold((BINS + 1) * BIN_NS)
    assert np.isnan(trace.span("rear_stroke_mm")).all()
    assert trace.last["rear_stroke_mm"] == pytest.approx(50, abs=0.02)


def test_long_jump(trace, frame):
    """After a silence of days, and frames of very different ages at once, only the last 20 s are there."""
    days = 10**6 * BIN_NS
    fed(trace, frame, [0, days], [10.0, 50.0])
    trace.fold(days)
    assert np.count_nonzero(~np.isnan(trace.means("rear_stroke_mm"))) == 1
    assert trace.span("rear_stroke_mm") == pytest.approx((50, 50), abs=0.02)


def test_same_whenever_folded(codec, frame):
    """How often somebody looks changes nothing of what there is to see."""
    once, often = (Trace(codec, codec.message("STROKES")) for _ in range(2))
    rng = np.random.default_rng(3)
    times = np.cumsum(rng.integers(1, 30, 300)) * MS
    values = rng.uniform(0, 110, 300)
    for k in range(300):
        data = frame("STROKES", rear_stroke_mm=values[k], alive=k * 3 % 16).data
        for trace in (once, often):
            trace.add(int(times[k]), data)
        often.fold(int(times[k]))
    for trace in (once, often):
        trace.fold(int(times[-1]))
    np.testing.assert_allclose(often.means("rear_stroke_mm"), once.means("rear_stroke_mm"), rtol=1e-12)
    assert often.span("rear_stroke_mm") == once.span("rear_stroke_mm")
    assert often.counter.lost == once.counter.lost > 0


def test_bounded(trace, frame):
    """Without anybody looking, what has gathered is decoded from time to time."""
    data = frame("STROKES").data
    for k in range(5000):
        trace.add(k * MS, data)
    assert len(trace._times) < 1024
