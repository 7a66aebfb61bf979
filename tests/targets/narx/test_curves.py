import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from targets.narx.curves import aoc, least_of_worst, rec, soe

ERRORS = st.lists(
    arrays(np.float64, st.integers(1, 40), elements=st.floats(0.0, 1e3).map(lambda x: round(x, 1))),
    min_size=1,
    max_size=4,
)
"""Runs of errors in percent, with ties."""


def at(curve, tolerance):
    """Value of a step function at a tolerance."""
    return curve.share[np.searchsorted(curve.tolerance_percent, tolerance, side="right") - 1]


def test_rec_by_hand():
    """REC is the share of samples within the tolerance (III.3)."""
    curve = rec([np.array([4.0, 1.0]), np.array([1.0, 2.0])])
    assert curve.tolerance_percent.tolist() == [0.0, 1.0, 2.0, 4.0]
    assert curve.share.tolist() == [0.0, 0.5, 0.75, 1.0]


def test_rec_of_a_perfect_predictor():
    """A predictor that never errs has every sample within a tolerance of 0."""
    curve = rec([np.zeros(5)])
    assert (curve.tolerance_percent.tolist(), curve.share.tolist()) == ([0.0], [1.0])


@given(ERRORS, st.floats(0.0, 1e3))
def test_rec_is_the_distribution_function(errors, tolerance):
    """With every step kept, REC at any tolerance is the share of samples not above it."""
    every = np.concatenate(errors)
    curve = rec(errors)
    assert at(curve, tolerance) == np.mean(every <= tolerance)


@given(ERRORS, st.integers(4, 30))
def test_decimated_points_are_exact(errors, points):
    """A curve of fewer points than samples has its points on the whole curve, its ends among them."""
    every = np.concatenate(errors)
    curve = rec(errors, points)
    assert len(curve.share) <= (points if len(every) > points else len(every) + 1)
    assert (np.diff(curve.tolerance_percent) > 0).all()
    assert all(at(curve, x) == np.mean(every <= x) for x in curve.tolerance_percent)
    assert curve.tolerance_percent[0] == 0.0
    assert curve.tolerance_percent[-1] == every.max()
    assert curve.share[-1] == 1.0


def test_decimation_keeps_rise_and_tail():
    """Of 20 laps' samples with a long tail 400 points leave no gap, in share or in tolerance."""
    errors = [np.random.default_rng(k).exponential(4.0, 30_000) ** 1.5 for k in range(20)]
    curve = rec(errors, points=400)
    assert len(curve.share) <= 400
    assert np.diff(curve.share).max() < 0.006
    rise = curve.tolerance_percent <= np.quantile(np.concatenate(errors), 0.999)
    assert np.diff(curve.tolerance_percent[rise]).max() < 0.006 * curve.tolerance_percent[-1]


@given(ERRORS)
def test_aoc_is_the_area_over_rec(errors):
    """The area over REC, step by step, is AOC, and the mean error of all samples."""
    every = np.concatenate(errors)
    curve = rec(errors)
    area = np.sum((1.0 - curve.share[:-1]) * np.diff(curve.tolerance_percent))
    assert aoc(errors) == pytest.approx(area, abs=1e-9)
    assert aoc(errors) == pytest.approx(every.mean())


def test_truncated_aoc():
    """A tolerance axis that ends at 10 % counts an error of 50 % as 10: less than the mean error."""
    errors = [np.array([0.0, 4.0]), np.array([6.0, 50.0])]
    assert aoc(errors) == pytest.approx(15.0)
    assert aoc(errors, limit_percent=10.0) == pytest.approx(5.0)
    assert aoc(errors, limit_percent=50.0) == aoc(errors)


def test_soe_by_hand():
    """SOE is the share of windows whose mean error exceeds the tolerance (III.4)."""
    curve = soe([np.array([1.0, 3.0, 5.0, 3.0])], samples=2)  # means 2, 4, 4
    assert curve.tolerance_percent.tolist() == [0.0, 2.0, 4.0]
    assert curve.share == pytest.approx([1.0, 2 / 3, 0.0])


@given(ERRORS)
def test_soe_of_one_sample_is_the_rest_of_rec(errors):
    """With a window of one sample SOE is 1 - REC."""
    whole, rest = rec(errors), soe(errors, samples=1)
    assert np.array_equal(rest.tolerance_percent, whole.tolerance_percent)
    assert np.array_equal(rest.share, 1.0 - whole.share)


def test_windows_stay_in_their_runs():
    """No window holds the end of one run and the beginning of the next; a shorter run has none."""
    errors = [np.array([0.0, 0.0, 90.0]), np.array([90.0, 0.0, 0.0]), np.array([90.0])]
    # windows of 3: a mean of 30 in each long run. Across, there would be 60
    assert soe(errors, samples=3).tolerance_percent[-1] == pytest.approx(30.0)
    assert least_of_worst(errors, samples=3) == pytest.approx(30.0)


@given(ERRORS, st.integers(1, 10))
def test_soe_is_the_survivor_function(errors, samples):
    """SOE at each of its points is the share of all windows, run by run, with a larger mean error."""
    windows = [run[k : k + samples].mean() for run in errors for k in range(len(run) - samples + 1)]
    if not windows:
        with pytest.raises(ValueError, match="no run is as long"):
            soe(errors, samples)
        return
    curve = soe(errors, samples)
    # means by running sums differ from these in the last digits: look between the points
    middles = (curve.tolerance_percent[1:] + curve.tolerance_percent[:-1]) / 2
    apart = np.diff(curve.tolerance_percent) > 1e-6
    for middle, share in zip(middles[apart], curve.share[:-1][apart], strict=True):
        assert share == pytest.approx(np.mean(np.array(windows) > middle))


def test_least_of_the_worst_tenth():
    """Of 20 windows the worst tenth are two; the smaller of them is the figure of section III.4."""
    errors = [np.arange(20.0)]
    assert least_of_worst(errors, samples=1) == 18.0
    assert least_of_worst(errors, samples=1, share=0.05) == 19.0
    assert least_of_worst(errors, samples=1, share=1.0) == 0.0


@pytest.mark.parametrize(("share", "windows", "worst"), [(0.1, 30, 3), (0.1, 3, 1), (0.07, 100, 7)])
def test_worst_windows_are_rounded_up(share, windows, worst):
    """The worst are share * m windows, rounded up, and 0.07 * 100 is 7, whatever binary fractions say."""
    assert least_of_worst([np.arange(float(windows))], 1, share) == windows - worst


@given(ERRORS, st.sampled_from([0.05, 0.1, 0.25]))
def test_least_of_worst_lies_on_soe(errors, share):
    """SOE is below the share at the figure read off it, and not below it before."""
    value = least_of_worst(errors, 1, share)
    every = np.concatenate(errors)
    assert np.mean(every > value) < share
    assert np.mean(every >= value) >= share


def test_window_longer_than_every_run():
    """A window no run is as long as is refused, by its length."""
    with pytest.raises(ValueError, match="50 samples"):
        soe([np.ones(49), np.ones(20)], samples=50)


@pytest.mark.parametrize("share", [0.0, 1.5, np.nan])
def test_share_of_the_worst(share):
    """A share that is none is refused."""
    with pytest.raises(ValueError, match="worst"):
        least_of_worst([np.ones(5)], 1, share)


def test_nothing_to_draw():
    """A curve of no run is refused."""
    for draw in (rec, aoc, lambda errors: soe(errors, 1)):
        with pytest.raises(ValueError, match="no "):
            draw([])


def test_unfit_axis_and_points():
    """A tolerance axis of no length and a curve of three points are refused."""
    with pytest.raises(ValueError, match="axis"):
        aoc([np.ones(5)], limit_percent=0.0)
    with pytest.raises(ValueError, match="3 points"):
        rec([np.ones(5)], points=3)
