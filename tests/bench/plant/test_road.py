import numpy as np
import pytest

from bench.plant.road import LEAD_IN_M, STEP_M, _envelope, build_road
from bench.plant.route import Stretch
from bench.plant.surface import SURFACES


def seeds(seed=0):
    return np.random.SeedSequence(seed)


def x_of(road):
    return np.arange(len(road.height_m)) * STEP_M - LEAD_IN_M


def density(height, low, high):
    """Mean one-sided displacement density (m3) between two spatial frequencies (cycles/m)."""
    window = np.hanning(len(height))
    spectrum = np.abs(np.fft.rfft((height - height.mean()) * window)) ** 2
    spectrum *= 2 * STEP_M / np.sum(window**2)
    n = np.fft.rfftfreq(len(height), STEP_M)
    return spectrum[(n > low) & (n < high)].mean()


@pytest.mark.parametrize("surface", ["smooth", "urban", "rough_urban"])
def test_roughness_is_the_surfaces(surface):
    """The spectrum at 0.1 cycles/m is the surface's, within the spread between stretches and chance."""
    found = [
        density(build_road((Stretch(surface, 2000, 50),), seeds(k)).height_m, 0.09, 0.111) for k in range(8)
    ]
    assert np.mean(found) == pytest.approx(SURFACES[surface].roughness_m3, rel=0.3)


def test_roughness_falls_with_the_square_of_frequency():
    """From 0.1 to 1 cycles/m the density falls by about a hundred (ISO 8608, waviness 2)."""
    height = build_road((Stretch("urban", 4000, 50),), seeds()).height_m
    assert density(height, 0.08, 0.125) / density(height, 0.8, 1.25) == pytest.approx(100, rel=0.5)


def test_cobblestones_are_rougher_at_the_length_of_a_stone():
    """Around 3 cycles/m a cobblestone stretch is well above what its long waves alone would give."""
    height = build_road((Stretch("cobblestone", 400, 30),), seeds()).height_m
    assert density(height, 2, 4) > 2.5 * SURFACES["cobblestone"].roughness_m3 * (0.1 / 3) ** 2


def test_a_rough_stretch_begins_without_a_step():
    """Where one surface ends and another begins the road is continuous."""
    height = build_road((Stretch("smooth", 100, 50), Stretch("cobblestone", 100, 50)), seeds()).height_m
    border = round((LEAD_IN_M + 100) / STEP_M)
    assert abs(height[border + 3] - height[border - 3]) < 0.01


def test_both_wheels_start_on_the_flat():
    """The first metres are level at height zero."""
    road = build_road((Stretch("cobblestone", 100, 50),), seeds())
    assert np.all(road.height_m[x_of(road) < -0.1] == 0.0)


def test_bumps_stand_where_the_route_says():
    """Four bumps stand 30 m apart, as high and as long as asked."""
    stretch = Stretch("smooth", 130, 30, bumps=4, bump_lead_m=15.0)
    bare = build_road((Stretch("smooth", 130, 30),), seeds())
    bumps = build_road((stretch,), seeds()).height_m - bare.height_m
    tops = np.flatnonzero((bumps[1:-1] > bumps[:-2]) & (bumps[1:-1] >= bumps[2:]) & (bumps[1:-1] > 0.04)) + 1
    assert x_of(bare)[tops] == pytest.approx(15.45 + 30.0 * np.arange(4), abs=0.03)
    assert bumps.max() == pytest.approx(stretch.bump_height_m, rel=0.05)
    assert np.count_nonzero(bumps > 1e-4) * STEP_M / 4 == pytest.approx(stretch.bump_length_m, abs=0.15)


def test_height_follows_the_grade():
    """Between two places far apart the road rises by what its grade sums up to."""
    road = build_road((Stretch("smooth", 3000, 50),), seeds(3))
    rise = np.sum(road.grade) * STEP_M
    assert abs(rise) > 1.0
    assert road.height_m[-1] == pytest.approx(rise, abs=0.1)


def test_same_seed_same_road():
    """A seed gives one road, another seed another."""
    stretches = (Stretch("urban", 300, 50),)
    one, again, other = (build_road(stretches, seeds(k)).height_m.tobytes() for k in (1, 1, 2))
    assert one == again != other


def test_a_longer_route_begins_with_the_same_road():
    """Stretches added at the end leave the road before them as it was."""
    first = Stretch("cobblestone", 200, 30)
    short = build_road((first,), seeds()).height_m
    long = build_road((first, Stretch("urban", 500, 50)), seeds()).height_m
    n = round((LEAD_IN_M + 199) / STEP_M)
    assert short[:n].tobytes() == long[:n].tobytes()


def test_envelope_keeps_place_and_slope():
    """Enveloping neither shifts nor lowers a long slope, and takes the edge off a short step."""
    ramp = np.arange(100.0)
    assert _envelope(ramp)[10:90] == pytest.approx(ramp[10:90])
    step = _envelope(np.repeat([0.0, 1.0], 50))
    assert np.all(np.diff(step) >= -1e-12)
    assert np.diff(step).max() < 0.3
    assert step[49] + step[50] == pytest.approx(1.0)
