import numpy as np
import pytest

from bench.errors import RouteError
from bench.plant.road.grid import STEP_M
from bench.plant.road.obstacles import KINDS, Obstacle, put

LONG = {"plateau": 7.0, "rail_crossing": 2.4, "step": 0.1}


def rng(seed=0):
    return np.random.default_rng(seed)


def one(kind, height=0.03, length=None, first=2.0):
    return Obstacle(kind, first, height, length or LONG.get(kind, 0.6))


def laid(obstacle, metres=40.0, seed=0):
    heights = np.zeros(round(metres / STEP_M))
    rise = put(obstacle, heights, rng(seed))
    return heights, rise


@pytest.mark.parametrize("kind", KINDS)
def test_nothing_but_the_obstacle_is_changed(kind):
    """Before an obstacle the road is as it was, and after it too, but for a step, which stays."""
    obstacle = one(kind)
    heights, rise = laid(obstacle)
    first, last = (round(x / STEP_M) for x in (2.0, 2.0 + obstacle.length_m))
    assert np.all(heights[:first] == 0.0)
    assert np.all(heights[last + 1 :] == pytest.approx(rise))
    assert rise == (pytest.approx(0.03) if kind == "step" else 0.0)


@pytest.mark.parametrize("kind", KINDS)
def test_height_is_the_highest_or_deepest_point(kind):
    """Every kind reaches the height asked for, or that depth, and no further."""
    heights, _ = laid(one(kind))
    assert np.abs(heights).max() == pytest.approx(0.03, rel=0.12)
    assert np.abs(heights).max() <= 0.03 + 1e-12


@pytest.mark.parametrize("kind", ["dip", "pothole", "drain_well"])
def test_holes_go_down(kind):
    """Nothing of a hole stands above the road."""
    heights, _ = laid(one(kind))
    assert heights.max() <= 0.0


@pytest.mark.parametrize("kind", ["bump", "plateau"])
def test_humps_go_up(kind):
    """Nothing of a hump lies below the road."""
    heights, _ = laid(one(kind))
    assert heights.min() >= 0.0


def test_a_plateau_is_flat_on_top():
    """Nearly half of a speed table lies at its full height."""
    heights, _ = laid(one("plateau"))
    assert np.count_nonzero(heights > 0.03 - 1e-9) * STEP_M == pytest.approx(0.46 * 7.0, abs=0.1)


def test_a_drain_well_is_steep_at_both_edges():
    """A sunken cover reaches its depth within 6 cm and has a flat floor."""
    heights, _ = laid(one("drain_well"))
    floor = np.flatnonzero(heights < -0.03 + 1e-9) * STEP_M
    assert (floor[0], floor[-1]) == (pytest.approx(2.04, abs=0.03), pytest.approx(2.56, abs=0.03))


def test_a_pothole_is_steeper_where_it_ends():
    """A pothole is ridden into gently and left over an edge."""
    heights, _ = laid(one("pothole"))
    assert np.diff(heights).max() > 2 * -np.diff(heights).min()


def test_rails_are_a_gauge_apart():
    """A crossing has two rails, standard gauge between them, with a groove on the inner side of each."""
    heights, _ = laid(one("rail_crossing"))
    rails, grooves = np.flatnonzero(heights > 0.02), np.flatnonzero(heights < -0.02)
    left, right = np.split(rails, np.flatnonzero(np.diff(rails) > 5) + 1)
    assert (right[0] - left[-1]) * STEP_M == pytest.approx(1.435, abs=0.05)
    assert left[-1] < grooves[0] < grooves[-1] < right[0]


def test_a_step_may_go_down():
    """A step of negative height lowers the road from there on."""
    heights, rise = laid(one("step", height=-0.04))
    assert rise == pytest.approx(-0.04)
    assert heights[-1] == pytest.approx(-0.04)


def test_steps_add_up():
    """Three steps of 2 cm lift the road by 6 cm."""
    heights, rise = laid(Obstacle("step", 1.0, 0.02, 0.1, count=3, spacing_m=5.0))
    assert rise == pytest.approx(0.06)
    assert heights[-1] == pytest.approx(0.06)


def test_a_sequence_is_evenly_spaced():
    """Four bumps 30 m apart begin 30 m apart."""
    assert Obstacle("bump", 15.0, 0.05, 0.9, count=4).places_m(rng()) == pytest.approx([15, 45, 75, 105])


def test_jitter_makes_a_sequence_irregular():
    """With jitter 0.5 spacings scatter between half and one and a half of what is asked, by seed."""
    obstacle = Obstacle("bump", 5.0, 0.02, 1.0, count=200, spacing_m=10.0, spacing_jitter=0.5)
    gaps = np.diff(obstacle.places_m(rng()))
    assert gaps.min() >= 5.0
    assert gaps.max() <= 15.0
    assert gaps.std() == pytest.approx(10 * 0.5 / np.sqrt(3), rel=0.2)
    assert not np.array_equal(gaps, np.diff(obstacle.places_m(rng(1))))


def test_a_sequence_never_needs_more_than_it_says():
    """Over twenty seeds the last of an irregular sequence ends within the length it says it needs."""
    obstacle = Obstacle("dip", 5.0, 0.02, 1.0, count=30, spacing_m=4.0, spacing_jitter=0.7)
    for seed in range(20):
        assert obstacle.places_m(rng(seed))[-1] + obstacle.length_m <= obstacle.need_m


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"kind": "crater"}, "unknown kind 'crater'; the known ones are bump, dip"),
        ({"kind": ["bump"]}, r"unknown kind \['bump'\]"),
        ({"count": 0}, "count is 0, not a number from 1"),
        ({"count": 2.0}, "count is 2.0, not a whole number"),
        ({"count": True}, "count is True, not a whole number"),
        ({"first_m": -1.0}, "first_m is -1.0, not a number from 0"),
        ({"height_m": 0.2}, "height_m is 0.2, not a number from 0 to 0.15"),
        ({"height_m": -0.02}, "height_m is -0.02, not a number from 0 to 0.15"),
        ({"height_m": float("nan")}, "height_m is nan, not a number"),
        ({"height_m": "high"}, "height_m is 'high', not a number"),
        ({"length_m": 20}, "length_m is 20, not a number from 0.2 to 10"),
        ({"kind": "rail_crossing"}, "length_m is 0.9, not a number from 1.8 to 10"),
        ({"spacing_jitter": 1.0}, "spacing_jitter is 1.0, not a number from 0 to 0.9"),
        (
            {"spacing_m": 1.0, "spacing_jitter": 0.5, "count": 2},
            "bumps of length_m 0.9 overlap at spacing_m 1",
        ),
    ],
)
def test_refuses_what_cannot_lie_on_a_road(change, says):
    """An obstacle that cannot be is refused with its key and value."""
    values = {"kind": "bump", "first_m": 15.0, "height_m": 0.05, "length_m": 0.9} | change
    with pytest.raises(RouteError, match=says):
        Obstacle(**values)
