from collections import Counter

import numpy as np
import pytest

from bench.errors import RouteError
from bench.plant.route import NAMES, Route, Stretch, checked_seed, load_route, shuffled


def load(tmp_path, text):
    path = tmp_path / "way.toml"
    path.write_text(text, encoding="utf-8")
    return load_route(path)


STRETCH = '[[stretch]]\nsurface = "urban"\nlength_m = 100\nspeed_kmh = 50\n'


@pytest.mark.parametrize("name", NAMES)
def test_named_routes_load(name):
    """Every route that comes with the bench is found by its name."""
    assert load_route(name).name == name


def test_mixed_route_is_the_thesiss():
    """About 5 km and 300 s: 50 m of cobblestone, town at 50, country at 90 km/h, four bumps 30 m apart."""
    route = load_route("mixed_5km")
    assert route.length_m == pytest.approx(5000, rel=0.02)
    assert route.nominal_s == pytest.approx(300, rel=0.05)
    stones = [stretch.length_m for stretch in route.stretches if stretch.surface == "cobblestone"]
    assert stones == [50]
    speeds = {stretch.surface: stretch.speed_kmh for stretch in route.stretches if not stretch.bumps}
    assert (speeds["rough_urban"], speeds["extra_urban"]) == (50, 90)
    obstacles = [(stretch.bumps, stretch.bump_spacing_m) for stretch in route.stretches if stretch.bumps]
    assert obstacles == [(4, 30)]


def test_a_file_is_a_route(tmp_path):
    """A TOML file gives the stretches it lists, in order, named after the file."""
    route = load(tmp_path, STRETCH + STRETCH.replace("urban", "smooth"))
    assert route == Route("way", (Stretch("urban", 100, 50), Stretch("smooth", 100, 50)))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", r"no \[\[stretch\]\]"),
        ("stretch = 3", r"no \[\[stretch\]\]"),
        ("stretch = [3]", "stretch 1 is 3, not a table"),
        ("= 3", "not TOML"),
        (STRETCH + "[weather]\nrain = true\n", "unknown key weather"),
        ("shuffle = 1\n" + STRETCH, "shuffle is 1, not true or false"),
        (STRETCH.replace("urban", "ice"), "stretch 1: unknown surface 'ice'; the known ones are smooth"),
        (STRETCH.replace('"urban"', "[1]"), r"stretch 1: unknown surface \[1\]"),
        (STRETCH + STRETCH.replace("speed_kmh", "speed"), "stretch 2: unknown key speed"),
        (STRETCH.replace("speed_kmh = 50\n", ""), "stretch 1: missing speed_kmh"),
        (STRETCH.replace("50", "'fast'"), "stretch 1: speed_kmh is 'fast', not a number from 10 to 200"),
        (STRETCH.replace("50", "250"), "stretch 1: speed_kmh is 250, not a number from 10 to 200"),
        (STRETCH.replace("50", "nan"), "stretch 1: speed_kmh is nan, not a number"),
        (STRETCH.replace("50", "true"), "stretch 1: speed_kmh is True, not a number"),
        (STRETCH.replace("100", "-1"), "stretch 1: length_m is -1, not a number from 1"),
        (STRETCH + "bumps = 2.5\n", r"stretch 1: bumps is 2\.5, not a whole number"),
        (STRETCH + "bumps = 5\n", "5 bumps need 135.9 m, the stretch is 100 m long"),
        (STRETCH + "bump_height_m = 1\n", r"bump_height_m is 1, not a number from 0 to 0\.15"),
    ],
)
def test_refuses_what_is_no_route(tmp_path, text, says):
    """A route that cannot be ridden is one line with the file, the stretch and the value."""
    with pytest.raises(RouteError, match=says) as refusal:
        load(tmp_path, text)
    assert "way.toml: " in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_a_route_without_stretches_is_none():
    """A route of no stretches is refused by name."""
    with pytest.raises(RouteError, match="route empty has no stretch"):
        Route("empty", ())


def test_unknown_name_lists_the_known_ones():
    """A route of no known name is refused with the known names."""
    with pytest.raises(
        RouteError, match="unknown route 'nordschleife'; the known ones are mixed_5km, training"
    ):
        load_route("nordschleife")


def test_missing_file_is_named(tmp_path):
    """A file that does not exist is refused by name."""
    with pytest.raises(RouteError, match=r"none\.toml: cannot be read: No such file"):
        load_route(tmp_path / "none.toml")


@pytest.mark.parametrize(("seed", "says"), [(-1, "-1, below 0"), (1.5, "1.5, not"), ("1", "'1', not")])
def test_refuses_seeds_that_are_none(seed, says):
    """A seed is a whole number from zero."""
    with pytest.raises(RouteError, match=f"seed is {says}"):
        checked_seed(seed)


def test_numpy_integers_are_seeds():
    """A seed counted by numpy is the same seed."""
    assert checked_seed(np.int64(7)) == 7


def test_shuffling_depends_on_the_seed_alone():
    """A seed gives one route, another seed another."""
    route = load_route("training")
    assert shuffled(route, 1) == shuffled(route, 1) != shuffled(route, 2)


def test_shuffling_keeps_every_surface():
    """A shuffled route has the same surfaces as often, in another order and of other lengths."""
    route = load_route("training")
    other = shuffled(route, 1)
    surfaces = [[stretch.surface for stretch in way.stretches] for way in (route, other)]
    assert Counter(surfaces[0]) == Counter(surfaces[1])
    assert surfaces[0] != surfaces[1]
    assert {stretch.length_m for stretch in other.stretches} != {s.length_m for s in route.stretches}


def test_shuffling_makes_no_bump_faster_or_higher():
    """Over twenty seeds bumps are ridden no faster and are no higher than the route says."""
    route = load_route("training")
    fastest = max(stretch.speed_kmh for stretch in route.stretches if stretch.bumps)
    for seed in range(20):
        for stretch in shuffled(route, seed).stretches:
            if stretch.bumps:
                assert stretch.speed_kmh <= fastest
                assert stretch.bump_height_m <= 0.05
