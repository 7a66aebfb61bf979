import numpy as np
import pytest

from bench.errors import RouteError
from bench.plant.road import LEAD_IN_M, STEP_M, build_road
from bench.plant.road.obstacles import Obstacle
from bench.plant.road.profiles import Profile
from bench.plant.road.spectrum import measured
from bench.plant.road.stretch import Stretch
from bench.plant.road.surface import SURFACES


def seeds(seed=0):
    return np.random.SeedSequence(seed)


def x_of(road):
    return np.arange(len(road.height_m)) * STEP_M - LEAD_IN_M


def without_hills(road):
    return road.height_m - np.cumsum(road.grade * STEP_M)


@pytest.mark.parametrize("surface", ["smooth", "urban", "rough_urban"])
def test_roughness_is_the_surfaces(surface):
    """At 0.1 cycles/m a road of ten stretches has its surface's density, within their spread and chance."""
    stretches = (Stretch(surface, 600, 50),) * 10
    found = [measured(without_hills(build_road(stretches, seeds(k))), STEP_M) for k in range(2)]
    near = np.abs(np.log2(found[0].n_per_m / 0.1)) < 0.5
    level = np.mean([g[near] for _, g in found])
    assert level == pytest.approx(SURFACES[surface].roughness_m3, rel=0.3)


def test_stretches_of_one_surface_differ_a_little():
    """The roughness of thirty stretches of one surface scatters by some 9 % in amplitude, not by more."""
    found = []
    for k in range(30):
        height = without_hills(build_road((Stretch("urban", 400, 50),), seeds(k)))
        found.append(np.std(np.diff(height)))
    assert 0.05 < np.std(found) / np.mean(found) < 0.13


def test_a_rough_stretch_begins_without_a_step():
    """Where one surface ends and another begins the road is continuous."""
    height = build_road((Stretch("smooth", 100, 50), Stretch("cobblestone", 100, 50)), seeds()).height_m
    border = round((LEAD_IN_M + 100) / STEP_M)
    assert abs(height[border + 3] - height[border - 3]) < 0.01


def test_stretches_begin_at_the_level_of_the_hills():
    """At each border the road is where the grade alone would have brought it, within 2 mm."""
    road = build_road((Stretch("urban", 100, 50), Stretch("urban", 70, 50)), seeds())
    for border in (100, 170):
        k = round((LEAD_IN_M + border) / STEP_M)
        assert without_hills(road)[k] == pytest.approx(0.0, abs=0.002)


def test_both_wheels_start_on_the_flat():
    """The first metres are level at height zero."""
    road = build_road((Stretch("cobblestone", 100, 50),), seeds())
    assert np.all(road.height_m[x_of(road) < -0.1] == 0.0)


def test_bumps_stand_where_the_route_says():
    """Four bumps stand 30 m apart, as high and as long as asked, on the road there was."""
    bump = Obstacle("bump", 15.0, 0.05, 0.90, count=4)
    bare = build_road((Stretch("smooth", 130, 30),), seeds())
    bumps = build_road((Stretch("smooth", 130, 30, obstacles=(bump,)),), seeds()).height_m - bare.height_m
    tops = np.flatnonzero((bumps[1:-1] > bumps[:-2]) & (bumps[1:-1] >= bumps[2:]) & (bumps[1:-1] > 0.04)) + 1
    assert x_of(bare)[tops] == pytest.approx(15.45 + 30.0 * np.arange(4), abs=0.03)
    assert bumps.max() == pytest.approx(0.05, rel=0.05)
    assert np.count_nonzero(bumps > 1e-4) * STEP_M / 4 == pytest.approx(0.90, abs=0.15)


def test_a_step_lifts_the_rest_of_the_road():
    """After a step of 3 cm the following stretch lies 3 cm higher than without it."""
    step = Obstacle("step", 20.0, 0.03, 0.1)
    rest = Stretch("urban", 100, 50)
    bare = build_road((Stretch("smooth", 50, 30), rest), seeds()).height_m
    lifted = build_road((Stretch("smooth", 50, 30, obstacles=(step,)), rest), seeds()).height_m
    after = round((LEAD_IN_M + 60) / STEP_M)
    assert lifted[after:] - bare[after:] == pytest.approx(0.03)


def test_a_profile_is_ridden_there_and_back():
    """A profile of 10 m fills 45 m mirror-wise, and the next stretch goes on where it ends."""
    measured_road = 0.02 * np.sin(np.arange(501) * 0.004)
    profile = Profile("wave", measured_road)
    road = build_road((Stretch(None, 45, 30, profile=profile), Stretch("smooth", 20, 30)), seeds())
    height = without_hills(road)[round(LEAD_IN_M / STEP_M) :]
    assert height[:500] == pytest.approx(measured_road[:500], abs=1e-3)
    assert height[500:1001] == pytest.approx(measured_road[::-1], abs=1e-3)
    border = round(45 / STEP_M)
    assert height[border] == pytest.approx(measured_road[250], abs=1e-3)
    assert np.abs(np.diff(height)).max() < 0.005


def test_height_follows_the_grade():
    """Between two places far apart the road rises by what its grade sums up to."""
    road = build_road((Stretch("smooth", 3000, 50),), seeds(3))
    rise = np.sum(road.grade) * STEP_M
    assert abs(rise) > 1.0
    assert road.height_m[-1] == pytest.approx(rise, abs=0.01)


def test_grade_is_read_between_samples():
    """The grade at a place is that of the samples about it."""
    road = build_road((Stretch("smooth", 300, 50),), seeds())
    assert road.grade_at(np.array([100 * STEP_M, 5000 * STEP_M])) == pytest.approx(road.grade[[100, 5000]])


def test_same_seed_same_road():
    """A seed gives one road, another seed another."""
    stretches = (Stretch("urban", 300, 50),)
    one, again, other = (build_road(stretches, seeds(k)).height_m.tobytes() for k in (1, 1, 2))
    assert one == again != other


def test_a_longer_route_begins_with_the_same_road():
    """Stretches added at the end leave the road before them as it was."""
    dips = Obstacle("dip", 3.0, 0.03, 1.0, count=8, spacing_m=12.0, spacing_jitter=0.5)
    first = Stretch("cobblestone", 200, 30, obstacles=(dips,))
    short = build_road((first,), seeds()).height_m
    long = build_road((first, Stretch("urban", 500, 50)), seeds()).height_m
    n = round((LEAD_IN_M + 199) / STEP_M)
    assert short[:n].tobytes() == long[:n].tobytes()


def test_stretches_of_one_kind_are_not_the_same_road():
    """Two equal stretches in a row have stones of their own."""
    height = without_hills(build_road((Stretch("cobblestone", 100, 30),) * 2, seeds()))
    first, second = np.split(height[round(LEAD_IN_M / STEP_M) :][:10_000], 2)
    assert abs(np.corrcoef(np.diff(first), np.diff(second))[0, 1]) < 0.2


WAVE = Profile("wave", np.zeros(501))


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"surface": "ice"}, "unknown surface 'ice'; the known ones are smooth"),
        ({"surface": None}, "unknown surface None"),
        ({"profile": WAVE}, "surface 'urban' and profile wave: a stretch has one"),
        ({"length_m": 0.5}, "length_m is 0.5, not a number from 1"),
        ({"speed_kmh": 5}, "speed_kmh is 5, not a number from 10 to 300"),
        ({"lean_deg": 41}, "lean_deg is 41, not a number from 0 to 40"),
        ({"lean_deg": True}, "lean_deg is True, not a number"),
        (
            {"obstacles": (Obstacle("bump", 15.0, 0.05, 0.9, count=5),)},
            "obstacle 1: 5 bump may need 135.9 m, the stretch is 100 m long",
        ),
    ],
)
def test_refuses_stretches_that_are_none(values, says):
    """A stretch outside its limits is refused with the key and the value."""
    with pytest.raises(RouteError, match=says):
        Stretch(**({"surface": "urban", "length_m": 100, "speed_kmh": 50} | values))
