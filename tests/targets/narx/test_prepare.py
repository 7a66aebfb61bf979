import numpy as np
import pytest

from targets.errors import TrainingError
from targets.narx.prepare import RANGES, edit_outliers, normalised, physical, shifted


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
    edited, share = edit_outliers(spoiled)
    assert share == pytest.approx(0.01)
    assert edited[50] == pytest.approx((values[49] + values[51]) / 2)
    assert np.array_equal(np.delete(edited, 50), np.delete(values, 50))
    assert spoiled[50] == 40.0


def test_edit_leaves_a_resting_channel():
    """A channel that mostly rests has no deviation to judge by and stays as it is."""
    values = np.zeros(100)
    values[10:20] = 5.0
    edited, share = edit_outliers(values)
    assert share == 0.0
    assert np.array_equal(edited, values)
