import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from targets.errors import TrainingError
from targets.narx.prepare import (
    RANGES,
    edited,
    normalised,
    physical,
    resampled,
    shifted,
)


@pytest.mark.parametrize("name", sorted(RANGES))
def test_ranges_become_one(name):
    """A sensor's range maps to [-1, 1], its middle to 0, and back."""
    lo, hi = RANGES[name]
    values = np.array([lo, (lo + hi) / 2, hi])
    assert np.allclose(normalised(values, RANGES[name]), [-1.0, 0.0, 1.0])
    assert np.allclose(physical(normalised(values, RANGES[name]), RANGES[name]), values)


def test_shift():
    """A shift of 2 pairs the inputs at t with the output at t + 2."""
    u, y = shifted(np.arange(10.0)[:, None], np.arange(10.0), 2)
    assert len(u) == len(y) == 8
    assert np.array_equal(y - u[:, 0], np.full(8, 2.0))


@pytest.mark.parametrize("samples", [-1, 10])
def test_shift_out_of_a_sequence(samples):
    """A shift that leaves nothing, or goes back, is refused."""
    with pytest.raises(TrainingError, match="shift"):
        shifted(np.zeros((10, 1)), np.zeros(10), samples)


def test_edit_takes_a_spike():
    """A spike beyond 3 robust sigmas is replaced by the line between its neighbours; the share is told."""
    values = np.sin(np.arange(100.0))
    spoiled = values.copy()
    spoiled[50] = 40.0
    result = edited([spoiled])
    assert result.share == pytest.approx(0.01)
    assert result.runs[0][50] == pytest.approx((values[49] + values[51]) / 2)
    assert np.array_equal(np.delete(result.runs[0], 50), np.delete(values, 50))
    assert spoiled[50] == 40.0


def test_edit_leaves_a_resting_channel():
    """A channel that mostly rests has no deviation to judge by and stays as it is."""
    values = np.zeros(100)
    values[10:20] = 5.0
    result = edited([values])
    assert result.share == 0.0
    assert np.array_equal(result.runs[0], values)


def test_edit_by_hand():
    """Median 3 and deviation 1.4826 accept up to 3 + 3 sigma = 7.45: of 7.4 and 7.5 only the last goes."""
    result = edited([[1.0, 2.0, 3.0, 4.0, 7.4], [2.0, 7.5, 2.0, 3.0, 4.0]])
    assert (result.median, result.deviation) == (3.0, pytest.approx(1.4826))
    assert (result.replaced, result.samples, result.share) == (1, 10, 0.1)
    assert result.runs[0].tolist() == [1.0, 2.0, 3.0, 4.0, 7.4]
    assert result.runs[1].tolist() == [2.0, 2.0, 2.0, 3.0, 4.0]


def test_edit_to_the_letter():
    """With scale 1 the median absolute deviation itself is the sigma: 6.1 is beyond 3 + 3 then."""
    run = [1.0, 2.0, 3.0, 4.0, 6.1]
    assert edited([run]).replaced == 0
    assert edited([run], scale=1.0).replaced == 1


def test_edit_stays_in_its_run():
    """An outlier at the end of a run takes its own neighbour's value, not one of the next run."""
    first, second = np.array([1.0, 2.0, 3.0, 90.0]), np.array([4.0, 3.0, 2.0, 1.0])
    assert edited([first, second]).runs[0].tolist() == [1.0, 2.0, 3.0, 3.0]


def test_edit_of_a_run_of_outliers():
    """A run that is outliers alone has nothing to be mended from and is refused by channel and number."""
    rng = np.random.default_rng(2)
    runs = [rng.normal(60.0, 1.0, 100), np.zeros(10)]
    with pytest.raises(TrainingError, match="speed_kmh: every sample of run 1 is an outlier"):
        edited(runs, name="speed_kmh")


def test_edit_with_no_tolerance():
    """A rule by which every sample is an outlier is refused."""
    with pytest.raises(TrainingError, match="every sample"):
        edited([[1.0, 2.0]], sigmas=0.0)


@given(arrays(np.float64, st.integers(1, 50), elements=st.floats(-1e3, 1e3)))
def test_edited_values_are_accepted_ones(values):
    """Edited, every value is within the limits, and what was within them is as it was."""
    result = edited([values])
    if result.deviation == 0.0:
        assert np.array_equal(result.runs[0], values)
        return
    limit = 3.0 * result.deviation
    assert (np.abs(result.runs[0] - result.median) <= limit * (1 + 1e-9) + 1e-9).all()
    kept = np.abs(values - result.median) <= limit
    assert np.array_equal(result.runs[0][kept], values[kept])
    assert result.replaced == np.count_nonzero(~kept)


def test_plain_resampling_holds():
    """Without the filter, 1 kHz to 100 Hz takes every tenth sample: what the ECU sees on the bus."""
    values = np.random.default_rng(0).normal(size=(95, 2))
    result = resampled(values, 1000.0)
    assert np.array_equal(result.values, values[::10])
    assert result.dropped == 85
    assert result.removed_rms.tolist() == [0.0, 0.0]


def tone(hz: float, samples: int = 4000) -> np.ndarray:
    return np.sin(2.0 * np.pi * hz * np.arange(samples) / 1000.0 + 0.4)


@pytest.mark.parametrize("hz", [0.5, 10.0, 30.0, 40.0])
def test_filter_passes_without_delay(hz):
    """What a 100 Hz channel can hold passes unchanged and undelayed."""
    result = resampled(tone(hz), 1000.0, antialias=True).values
    assert np.abs(result - tone(hz)[::10])[50:-50].max() < 5e-4


def test_filter_stops_what_would_alias():
    """What would alias is less than one code of 12 bits after the filter; held, it is all there."""
    tones = np.stack([tone(hz) for hz in (*np.arange(50.0, 80.0, 0.25), 99.0, 150.0, 430.0)], axis=1)
    assert np.abs(resampled(tones, 1000.0, antialias=True).values)[50:-50].max() < 1.0 / 4096
    assert np.abs(resampled(tones, 1000.0).values).max(axis=0).min() > 0.3


def test_filter_tells_what_it_took():
    """The report is the rms of what the filter changed, by channel."""
    values = np.stack([tone(5.0), tone(5.0) + 0.5 * tone(95.0)], axis=1)
    removed = resampled(values, 1000.0, antialias=True).removed_rms
    assert removed[0] < 0.005
    assert removed[1] == pytest.approx(0.5 / np.sqrt(2.0), rel=0.02)


@given(
    st.integers(1, 700), st.floats(-50.0, 50.0), st.floats(-1.0, 1.0), st.sampled_from([10.0, 100.0, 250.0])
)
def test_filter_keeps_lines(samples, level, slope, to_hz):
    """A constant and a slope come through unchanged to the ends, however short the run."""
    values = level + slope * np.arange(samples)
    result = resampled(values, 1000.0, to_hz, antialias=True).values
    assert result == pytest.approx(values[:: round(1000.0 / to_hz)], abs=1e-9)


@pytest.mark.parametrize("rates", [(1000.0, 300.0), (100.0, 1000.0), (1000.0, 0.0), (np.nan, 100.0)])
def test_rates_that_do_not_divide(rates):
    """Rates whose ratio is not a whole number are refused."""
    with pytest.raises(TrainingError, match="n-th sample"):
        resampled(np.zeros(100), *rates)


@pytest.mark.parametrize(
    "step",
    [
        lambda values: resampled(values, 1000.0, name="fork_stroke_mm"),
        lambda values: edited([values], name="fork_stroke_mm"),
    ],
)
def test_values_not_finite(step):
    """A value that is not finite is refused with channel and sample, and so is a channel without any."""
    with pytest.raises(TrainingError, match="fork_stroke_mm is nan at sample 3"):
        step(np.array([1.0, 2.0, 3.0, np.nan, 5.0]))
    with pytest.raises(TrainingError, match="fork_stroke_mm has no sample"):
        step(np.zeros(0))
