import numpy as np
import pytest

from bench.plant.road.envelope import envelope


def test_a_long_slope_stays_as_it_is():
    """Enveloping neither shifts nor lowers a long slope."""
    ramp = np.arange(100.0)
    assert envelope(ramp)[10:90] == pytest.approx(ramp[10:90])


def test_a_step_loses_its_edge_and_keeps_its_place():
    """A step is spread over the contact length, about where it was."""
    step = envelope(np.repeat([0.0, 1.0], 50))
    assert np.all(np.diff(step) >= -1e-12)
    assert np.diff(step).max() < 0.3
    assert step[49] + step[50] == pytest.approx(1.0)
