"""The compiled decision: to the sample what the plain residual and rule of `targets.ifd` give."""

import numpy as np
import pytest

from campaigns.offline_lap import Cells
from targets.calibration import Detector
from targets.ifd import alarms, residual

CELLS = Cells((5.0, 10.0, 20.0), (10, 20, 50, 200), (1, 2, 3, 7), 0.1, 50)


def obvious(measured, predicted, cells):
    """Each cell's alarms over the whole ride, one detector at a time; bool (T, L, n, samples)."""
    return np.array(
        [
            [
                [
                    alarms(
                        residual(predicted, measured, detector),
                        detector,
                    )
                    for n in cells.n
                    for detector in [
                        Detector(t / 100.0, L // 10, n, "predicted", cells.warmup, cells.floor_mm)
                    ]
                ]
                for L in cells.L_ms
            ]
            for t in cells.T_percent
        ]
    )


def first(up, start=0):
    """The first sample from `start` on at which it is up, -1 for none; over the last axis."""
    later = up[..., start:]
    return np.where(later.any(axis=-1), later.argmax(axis=-1) + start, -1)


def ride(seed):
    """Measured and predicted strokes whose deviation comes and goes; some end below the floor."""
    rng = np.random.default_rng(seed)
    swell = np.sin(np.arange(600) / rng.uniform(15, 60) + rng.uniform(0, 6)) ** 2
    wander = 0.15 * swell + rng.normal(size=600) * 0.03
    predicted = 20.0 + 10.0 * np.sin(np.arange(600) / rng.uniform(5, 50))
    measured = predicted * (1.0 + wander)
    if seed % 5 == 0:
        measured[rng.integers(100, 500) :] = 0.0
    return measured, predicted


@pytest.mark.parametrize("seed", range(30))
def test_first_alarms_are_those_of_the_plain_rule(seed):
    """For every T, L and n the first alarm of a ride is where residual and rule first raise it."""
    measured, predicted = ride(seed)
    expected = first(obvious(measured, predicted, CELLS))
    assert (CELLS.first_alarms(measured, predicted, 0, 600) == expected).all()


def test_the_rides_try_every_answer():
    """The random rides hold early, late and no alarms, so that agreeing on them means something."""
    found = np.array([first(obvious(*ride(seed), CELLS)) for seed in range(30)])
    assert (found == -1).any()
    assert ((found >= 50) & (found < 60)).any()
    assert (found > 300).any()


def test_a_ride_may_be_joined_late():
    """From a sample on, with the history before it, alarms come as in the whole ride: none is forgotten."""
    alarmed = 0
    for seed in range(30):
        measured, predicted = ride(seed)
        start = int(np.random.default_rng(seed).integers(60, 500))
        up = obvious(measured, predicted, CELLS)
        quiet = ~up[..., :start].any(axis=-1)
        expected = first(up[..., :560], start)[quiet]
        assert (CELLS.first_alarms(measured, predicted, start, 560)[quiet] == expected).all()
        alarmed += np.count_nonzero(expected >= 0)
    assert alarmed > 50


def test_a_run_above_T_goes_on_across_the_start():
    """What was above T before the start counts: after n L - 1 samples of it the next one raises the alarm."""
    cells = Cells((10.0,), (20,), (4,), 0.1, 0)
    predicted = np.full(400, 10.0)
    for before in range(8):
        measured = predicted.copy()
        measured[300 - before :] = 8.0
        assert cells.first_alarms(measured, predicted, 300, 400).item() == 307 - before


def test_floor():
    """A stroke below the floor divides as the floor."""
    cells = Cells((15.0,), (10,), (1,), 0.1, 0)
    measured, predicted = np.full(9, 0.05), np.full(9, 0.06)
    assert cells.first_alarms(measured, predicted, 0, 9).item() == -1
    assert cells.first_alarms(10 * measured, 10 * predicted, 0, 9).item() == 0


def test_warm_up():
    """No exceedance of the warm-up counts towards an alarm."""
    cells = Cells((10.0,), (10,), (1, 3), 0.1, 50)
    measured, predicted = np.full(100, 8.0), np.full(100, 10.0)
    assert cells.first_alarms(measured, predicted, 0, 100).ravel().tolist() == [50, 52]
    assert cells.first_alarms(measured, predicted, 51, 100).ravel().tolist() == [50, 52]
