"""The baselines' settings as a calibration file carries them, and what is refused."""

import numpy as np
import pytest

from targets.baselines import Cusum, Persistence, Residual, document, first_alarm, read
from targets.errors import CalibrationError

EVERY = (Persistence(20, 0.2), Cusum(0.05, 3.0), Residual(20, 5, 0.1))


@pytest.mark.parametrize("baseline", EVERY, ids=lambda one: type(one).__name__)
def test_comes_back(baseline):
    """A baseline written and read is the same."""
    assert read(type(baseline).__name__.lower(), document(baseline)) == baseline


@pytest.mark.parametrize("baseline", EVERY, ids=lambda one: type(one).__name__)
def test_alarm(baseline):
    """Each is silent while measured and predicted agree, and not for long once they do not."""
    predicted = np.full(600, 50.0)
    assert first_alarm(baseline, predicted, predicted, 0) is None
    measured = np.where(np.arange(600) < 200, 50.0, 70.0)
    assert 200 <= first_alarm(baseline, predicted, measured, 0) <= 320


@pytest.mark.parametrize(
    ("name", "table", "says"),
    [
        ("other", {}, "baseline 'other' is none of persistence, cusum, residual"),
        ("cusum", {}, "baseline cusum has nothing, not drift, limit, floor_mm"),
        ("cusum", {"drift": 0.1, "shift": 1}, "baseline cusum has drift, shift, not drift, limit, floor_mm"),
        ("cusum", {"drift": "a"}, "baseline cusum: drift is 'a', not a finite number"),
        ("cusum", {"drift": float("nan")}, "drift is nan, not a finite number"),
        ("cusum", {"drift": 0.1, "floor_mm": 0}, r"floor_mm is 0\.0, a baseline takes 0\.001 to"),
        ("persistence", {"samples": 0}, "samples is 0, a baseline takes 1 to 10000"),
        ("persistence", {"samples": 2.5}, r"samples is 2\.5, not an integer"),
        ("residual", {"window": 20, "multiple": -1}, "multiple is -1, a baseline takes 1 to"),
        ("residual", {"window": 500, "multiple": 1}, "window is 500, a baseline takes 1 to 128"),
    ],
)
def test_refused(name, table, says):
    """What is no baseline, or none that could be run, is refused by its setting."""
    with pytest.raises(CalibrationError, match=says):
        read(name, table)
