import numpy as np
import pytest

from bench.plant.road.surface import SURFACES, Surface, lay


def seed(k=0):
    return np.random.SeedSequence(k)


@pytest.mark.parametrize("name", SURFACES)
def test_every_surface_begins_at_zero(name):
    """Every surface can be laid and begins at height zero."""
    height = lay(SURFACES[name], 1000, 1.0, seed())
    assert height.shape == (1000,)
    assert height[0] == 0.0


def test_a_factor_scales_the_amplitude():
    """A surface twice as rough in amplitude is the same one, twice as high."""
    one, two = (lay(SURFACES["cobblestone"], 500, factor, seed()) for factor in (1.0, 2.0))
    assert two == pytest.approx(2 * one)


def test_stones_lie_at_their_pitch():
    """On an even bed the corners of 5 m of stones lie every 10 cm and are at most 2.5 sigma high."""
    height = lay(Surface(1e-30, stone_m=0.004, stone_pitch_m=0.10), 250, 1.0, seed())
    bends = np.abs(np.diff(height, 2))
    corners = np.flatnonzero(bends > 1e-8) + 1
    assert set(corners) <= set(range(5, 250, 5))
    assert 0.006 < np.abs(height).max() <= 0.0100001


def test_stones_end_at_the_next_stretchs_level():
    """The last stone is worn down to zero, so that the next stretch begins without a step."""
    height = lay(Surface(1e-30, stone_m=0.004, stone_pitch_m=0.12), 497, 1.0, seed())
    assert abs(height[-1]) < 0.01 / 6
