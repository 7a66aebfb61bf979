import numpy as np
import pytest

from targets.narx.measures import best_constant, relative_error, rmse, skill


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
