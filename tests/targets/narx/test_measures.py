import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from targets.narx.measures import (
    best_constant,
    deviation,
    deviations,
    performance,
    relative_error,
    rmse,
    skill,
    sliding_mean,
)


def test_relative_error():
    """Er is the mean of |yp - yt| / |yt| in percent (III.2)."""
    assert relative_error([11.0, 18.0, -4.4], [10.0, 20.0, -4.0]) == pytest.approx(10.0)


def test_relative_error_of_a_topped_out_stroke():
    """A measured stroke of 0 counts as one code of the converter, not as infinity."""
    assert relative_error([110.0 / 4095.0], [0.0]) == pytest.approx(100.0)


def test_rmse():
    """RMSE is the root of the mean squared error."""
    assert rmse([1.0, 1.0, 1.0, 1.0], [1.0, 1.0, 1.0, 5.0]) == pytest.approx(2.0)


def test_best_constant():
    """No other constant has a smaller Er than the best one."""
    measured = np.random.default_rng(1).gamma(3.0, 10.0, 500) + 1.0
    others = np.linspace(measured.min(), measured.max(), 400)
    best = relative_error(np.full(500, best_constant(measured)), measured)
    assert best <= min(relative_error(np.full(500, other), measured) for other in others)


def test_skill():
    """Skill is 0 for the best constant, 1 for a perfect prediction, and counts against a reference."""
    measured = np.array([30.0, 35.0, 40.0, 50.0])
    assert skill(np.full(4, best_constant(measured)), measured) == 0.0
    assert skill(measured, measured) == 1.0
    assert skill(measured * 1.01, measured, reference=measured * 1.04) == pytest.approx(0.75)


def test_unequal_shapes():
    """A prediction of another length than the measurements is refused."""
    with pytest.raises(ValueError, match=r"\(3,\)"):
        rmse(np.zeros(3), np.zeros(4))


def test_deviation():
    """The deviation is 100 |yp - yt| / |yt| at each sample (III.3)."""
    assert deviation([11.0, 18.0, -3.0], [10.0, 20.0, -4.0]) == pytest.approx([10.0, 10.0, 25.0])


def test_skill_against_a_perfect_reference():
    """Against a reference without any error skill is 0 for another such prediction, else minus infinity."""
    measured = np.full(5, 40.0)
    assert skill(measured, measured) == 0.0
    assert skill(measured + 1.0, measured) == -np.inf


def test_sliding_mean():
    """The sliding mean has one value for every whole window (III.4)."""
    assert sliding_mean([1.0, 3.0, 5.0, 3.0], 2) == pytest.approx([2.0, 4.0, 4.0])
    assert sliding_mean([1.0, 3.0], 3).size == 0


@given(
    arrays(np.float64, st.integers(1, 60), elements=st.floats(0.0, 1e6)),
    st.integers(1, 60),
)
def test_sliding_mean_against_slices(values, samples):
    """Each sliding mean is that of its slice, and no less than the least value, whatever the rounding."""
    expected = [values[k : k + samples].mean() for k in range(len(values) - samples + 1)]
    means = sliding_mean(values, samples)
    assert means == pytest.approx(expected, abs=1e-6)
    assert means.size == 0 or means.min() >= values.min()


def test_performance_by_run():
    """Er is over all samples, and by run; the worst run is told."""
    runs = [(np.full(10, 11.0), np.full(10, 10.0)), (np.full(30, 26.0), np.full(30, 20.0))]
    result = performance(runs, rate_hz=10.0)
    assert result.run_er_percent == pytest.approx((10.0, 30.0))
    assert result.er_percent == pytest.approx(25.0)
    assert (result.worst_run, result.samples) == (1, 40)
    assert result.rmse == pytest.approx(np.sqrt((10 * 1.0 + 30 * 36.0) / 40))


def test_worst_second():
    """The worst second is found with its run and its beginning, seconds after that run's first sample."""
    first, second = np.full(50, 10.0), np.full(50, 10.0)
    predicted = second.copy()
    predicted[23:28] += 4.0  # half a second at 10 Hz: the first whole second with all of it begins at 1.8 s
    result = performance([(first, first), (predicted, second)], rate_hz=10.0, washout=5)
    assert result.worst_second_percent == pytest.approx(20.0)
    assert (result.worst_second_run, result.worst_second_s) == (1, pytest.approx(1.8))


def test_worst_second_is_of_one_run():
    """A second that would take the end of one run and the beginning of the next is none."""
    measured = np.full(20, 10.0)
    late, early = measured.copy(), measured.copy()
    late[-5:] += 10.0
    early[:5] += 10.0
    result = performance([(late, measured), (early, measured)], rate_hz=10.0)
    assert result.worst_second_percent == pytest.approx(50.0)


def test_washout_does_not_count():
    """What is predicted during the washout has no part in any figure."""
    measured = 40.0 + np.sin(np.arange(300.0))
    good, bad = measured + 0.5, measured + 0.5
    bad[:100] += 30.0
    figures = [performance([(p, measured)], 100.0, 100, reference=[p + 1.0]) for p in (good, bad)]
    assert figures[0] == figures[1]
    assert figures[0].samples == 200


def test_performance_skills():
    """Skill is against the best constant of all runs, and against another predictor's predictions."""
    runs = [(np.array([40.0, 44.0]), np.array([40.0, 40.0])), (np.array([50.0]), np.array([50.0]))]
    other = [np.array([44.0, 44.0]), np.array([50.0])]
    result = performance(runs, rate_hz=1.0, reference=other)
    assert result.constant == 40.0
    # Er: 10 / 3 %; of the constant 20 / 3 %; of the other 20 / 3 %
    assert result.skill == pytest.approx(0.5)
    assert result.skill_of_reference == pytest.approx(0.5)
    assert performance(runs, rate_hz=1.0).skill_of_reference is None


def test_deviations_run_by_run():
    """Deviations are one array a run, without its washout."""
    runs = [([1.0, 11.0], [1.0, 10.0]), ([1.0, 9.0, 6.0], [1.0, 10.0, 5.0])]
    one, two = deviations(runs, washout=1)
    assert one == pytest.approx([10.0])
    assert two == pytest.approx([10.0, 20.0])


@pytest.mark.parametrize(
    ("runs", "message"),
    [
        ([], "no run"),
        ([(np.ones(20), np.ones(20)), (np.ones(9), np.ones(9))], "run 1"),
        ([(np.array([1.0] * 12 + [np.nan] * 8), np.ones(20))], "run 0: the prediction is nan at sample 12"),
        ([(np.ones(20), np.array([1.0, np.inf] * 10))], "run 0: the measurement is inf at sample 1"),
        ([(np.ones(19), np.ones(19))], "whole second"),
    ],
)
def test_runs_without_figures(runs, message):
    """No run, one within the washout, one that is not finite, and none as long as a second are refused."""
    with pytest.raises(ValueError, match=message):
        performance(runs, rate_hz=10.0, washout=10)


def test_reference_of_other_runs():
    """Predictions of another number of runs are no reference."""
    with pytest.raises(ValueError, match="2 predictions of the reference for 1 runs"):
        performance([(np.ones(20), np.ones(20))], 10.0, reference=[np.ones(20)] * 2)
