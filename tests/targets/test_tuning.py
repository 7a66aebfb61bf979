"""Tuning the second detector: limits from peaks, windows from faults put in, and what is refused."""

import math

import numpy as np
import pytest

from targets.checks import findings, first_alarm
from targets.errors import TrainingError
from targets.tuning import BLOCK, limit, peaks, tune


def rides(count=6, seconds=120, error=0.02, seed=1):
    """A stroke that moves like a suspension's, predicted with a slowly varying relative error."""
    rng = np.random.default_rng(seed)
    out = []
    for _ in range(count):
        t = np.arange(seconds * 100) / 100
        waves = np.column_stack([rng.uniform(4, 20, 4), rng.uniform(0, 6, 4)])
        stroke = 55 + sum(4 * np.sin(speed * t + phase) for speed, phase in waves)
        slow = np.convolve(rng.normal(0, 1, len(t) + 49), np.ones(50) / 50**0.5, "valid")
        noisy = stroke + rng.normal(0, 0.03, len(t))
        out.append((stroke * (1 + error * slow), noisy))
    return out


def test_peaks_of_ten_seconds():
    """One peak for every whole ten seconds."""
    figure = np.arange(2.5 * BLOCK)
    assert peaks(figure).tolist() == [BLOCK - 1, 2 * BLOCK - 1]


def test_limit_is_the_level_of_an_exponential_tail():
    """For peaks with an exponential tail of scale 1 the limit is the level they pass once in 1000 hours."""
    rng = np.random.default_rng(3)
    per_hour = 3600 * 100 / BLOCK
    hours = 30.0
    highs = rng.exponential(1.0, int(hours * per_hour))
    assert limit(highs, hours, 0.001) == pytest.approx(math.log(per_hour / 0.001), rel=0.1)


def test_smaller_budget_is_a_higher_limit():
    """Fewer false alarms allowed, higher limit; never below what was seen."""
    highs = np.random.default_rng(4).exponential(1.0, 500)
    assert limit(highs, 1.4, 0.001) > limit(highs, 1.4, 0.1) >= highs.max()


def test_too_few_peaks_say_nothing():
    """From a handful of peaks no limit can be drawn."""
    assert limit(np.ones(10), 0.1, 0.01) == math.inf


def test_tuned_detector_is_quiet_and_finds_faults():
    """On the rides it was tuned on and on others it stays quiet, and finds a gain of 0.9 and a hold."""
    tuning = tune(rides(), 0.01)
    assert tuning.hours == pytest.approx(6 * 115 / 3600)
    for p, m in (*rides(), *rides(seed=2)):
        assert not findings(p, m, tuning.checks).alarm.any()
        lost, held = m.copy(), m.copy()
        lost[5000:] *= 0.9
        held[5000:] = held[4999]
        for faulty, kind in ((lost, "uncalibration"), (held, "hold")):
            at, named = first_alarm(p, faulty, 4000, tuning.checks)
            assert (5000 <= at < 5500, named) == (True, kind)


def test_worse_prediction_is_slower_to_judge():
    """The more the network errs, the higher the limits, and the longer a loss takes to find."""
    good, bad = tune(rides(error=0.01), 0.01), tune(rides(error=0.03), 0.01)
    assert bad.checks.loss_threshold > good.checks.loss_threshold
    assert bad.td_s["uncalibration"] > good.td_s["uncalibration"]


def test_error_too_large_to_find_a_loss_is_told():
    """Where the network errs more than the loss to be found, the share missed says so."""
    assert tune(rides(error=0.1), 0.001).missed["uncalibration"] > 0.5


def test_too_little_riding():
    """Less than thirty peaks of riding are refused, with the seconds there are."""
    with pytest.raises(TrainingError, match=r"115 s of fault-free riding, the detector needs 300"):
        tune(rides(count=1), 0.01)


@pytest.mark.parametrize("budget", [0.0, -1.0, math.nan])
def test_budget_that_cannot_be_met(budget):
    """A budget of none at all cannot be met by any limit."""
    with pytest.raises(TrainingError, match="budget"):
        tune(rides(), budget)
