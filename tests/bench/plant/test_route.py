from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from bench.errors import RouteError
from bench.plant.motorcycle import load_motorcycle
from bench.plant.ride import ride
from bench.plant.road.obstacles import Obstacle
from bench.plant.route import NAMES, Route, Stretch, checked_seed, load_route, shuffled

BIKE = load_motorcycle()
BLOCK = Path(__file__).resolve().parents[4] / "shared" / "data" / "road-profiles" / "belgian_block.crg"


@pytest.fixture
def belgian_block():
    if not BLOCK.is_file():
        pytest.skip(f"no measured road in {BLOCK}")
    return BLOCK


def load(tmp_path, text):
    path = tmp_path / "way.toml"
    path.write_text(text, encoding="utf-8")
    return load_route(path)


STRETCH = '[[stretch]]\nsurface = "urban"\nlength_m = 100\nspeed_kmh = 50\n'
PROFILE = STRETCH.replace('surface = "urban"', 'profile = "road.csv"')
BUMP = '[[stretch.obstacle]]\nkind = "bump"\nfirst_m = 15\nheight_m = 0.05\nlength_m = 0.9\n'


@pytest.mark.parametrize("name", NAMES)
def test_named_routes_load(name):
    """Every route that comes with the bench is found by its name."""
    assert load_route(name).name == name


@pytest.mark.parametrize("name", ["mixed_5km", "test_lap"])
def test_thesis_routes_are_the_thesiss(name):
    """About 300 s: 50 m of cobblestone, town at 50, country at 90 km/h, four bumps 30 m apart."""
    route = load_route(name)
    assert route.nominal_s == pytest.approx(300, rel=0.03)
    stones = [stretch.length_m for stretch in route.stretches if stretch.surface == "cobblestone"]
    assert stones == [50]
    speeds = {stretch.surface: stretch.speed_kmh for stretch in route.stretches if not stretch.obstacles}
    assert (speeds["rough_urban"], speeds["extra_urban"]) == (50, 90)
    obstacles = [obstacle for stretch in route.stretches for obstacle in stretch.obstacles]
    assert [(o.kind, o.count, o.spacing_m) for o in obstacles] == [("bump", 4, 30)]


def test_mixed_route_is_5_km_long():
    """The mixed route of section V.6 is about 5 km long."""
    assert load_route("mixed_5km").length_m == pytest.approx(5000, rel=0.02)


@pytest.mark.parametrize("name", ["mixed_5km", "training", "test_lap"])
def test_bends_are_leant_into(name):
    """Town is ridden at a lean of about 8 degrees, country at 15, cobblestones and bumps upright."""
    for stretch in load_route(name).stretches:
        upright = stretch.obstacles or stretch.surface == "cobblestone"
        expected = {"urban": 8, "rough_urban": 8, "extra_urban": 15, "smooth": 12}.get(stretch.surface)
        assert stretch.lean_deg == (0 if upright else expected)


BENCHMARKS = ("random", "motorway", "pave", "english_track", "short_back", "drain_well")


@pytest.mark.parametrize("name", BENCHMARKS)
def test_benchmark_roads_take_as_long_as_the_papers(name):
    """Each of the six roads of the paper on virtual sensors takes 13.7 s at least, however it is ridden."""
    assert name in NAMES
    for seed in range(3):
        assert ride(load_route(name), BIKE, seed).duration_ns >= 13.7e9


@pytest.mark.parametrize(
    ("name", "kinds"), [("english_track", {"bump", "dip", "pothole"}), ("drain_well", {"drain_well"})]
)
def test_benchmark_roads_have_their_obstacles(name, kinds):
    """The English track has bumps and holes in irregular sequences, the drain well its wells."""
    obstacles = [o for stretch in load_route(name).stretches for o in stretch.obstacles]
    assert {o.kind for o in obstacles} == kinds
    assert all((o.spacing_jitter > 0) == (name == "english_track") for o in obstacles)


@pytest.mark.parametrize("name", NAMES)
def test_every_route_can_be_ridden(name):
    """On the default motorcycle no stroke leaves its sensor's range on any of the bench's routes."""
    for seed in (1, 2, 3):
        ride(load_route(name), BIKE, seed)


def test_a_file_is_a_route(tmp_path):
    """A TOML file gives the stretches it lists, in order, named after the file."""
    route = load(tmp_path, STRETCH + STRETCH.replace("urban", "smooth"))
    assert route == Route("way", (Stretch("urban", 100, 50), Stretch("smooth", 100, 50)))


def test_obstacles_are_read(tmp_path):
    """Obstacles stand in the stretch they are listed under, with what is left out at its default."""
    route = load(tmp_path, STRETCH + BUMP + BUMP.replace("15", "50") + STRETCH)
    assert route.stretches[0].obstacles == (Obstacle("bump", 15, 0.05, 0.9), Obstacle("bump", 50, 0.05, 0.9))
    assert route.stretches[1].obstacles == ()


def test_a_measured_profile_is_a_stretch(tmp_path):
    """A profile beside the route's file is its stretch's road, and can be ridden."""
    rows = (f"{0.1 * k:.1f},{0.002 * np.sin(0.8 * k):.6f}" for k in range(100))
    (tmp_path / "road.csv").write_text("x_m,z_m\n" + "\n".join(rows), encoding="utf-8")
    route = load(tmp_path, PROFILE)
    assert route.stretches[0].profile.name == "road.csv"
    assert route.stretches[0].surface is None
    calm = load(tmp_path, STRETCH.replace("urban", "motorway"))
    shaken, smooth = (ride(r, BIKE, 0).channels["acc_front_ms2"].std() for r in (route, calm))
    assert shaken > 2 * smooth


def test_a_stretch_is_not_both(tmp_path):
    """A stretch of a surface and a profile is refused, with both."""
    (tmp_path / "road.csv").write_text("0,0\n5,0\n", encoding="utf-8")
    with pytest.raises(
        RouteError, match=r"stretch 1: surface 'urban' and profile road\.csv: a stretch has one"
    ):
        load(tmp_path, PROFILE + 'surface = "urban"\n')


def test_the_belgian_block_can_be_ridden(tmp_path, belgian_block):
    """Two hundred metres of the measured Belgian block at 30 km/h keep the strokes within their ranges."""
    text = PROFILE.replace("road.csv", str(belgian_block)).replace("50", "30").replace("100", "200")
    lap = ride(load(tmp_path, text + "profile_v_m = 0.4\n"), BIKE, 0)
    assert lap.channels["rear_stroke_mm"].std() > 2


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
        (STRETCH.replace("50", "'fast'"), "stretch 1: speed_kmh is 'fast', not a number from 10 to 300"),
        (STRETCH.replace("50", "350"), "stretch 1: speed_kmh is 350, not a number from 10 to 300"),
        (STRETCH.replace("50", "nan"), "stretch 1: speed_kmh is nan, not a number"),
        (STRETCH.replace("50", "true"), "stretch 1: speed_kmh is True, not a number"),
        (STRETCH.replace("100", "-1"), "stretch 1: length_m is -1, not a number from 1"),
        (STRETCH + "lean_deg = 50\n", "stretch 1: lean_deg is 50, not a number from 0 to 40"),
        (STRETCH.replace('surface = "urban"\n', ""), "stretch 1: missing surface or profile"),
        (STRETCH + "obstacle = 3\n", r"stretch 1: obstacle is 3, not \[\[stretch\.obstacle\]\]"),
        (STRETCH + "obstacle = [3]\n", "stretch 1: obstacle 1 is 3, not a table"),
        (
            STRETCH + BUMP + "colour = 1\n",
            "stretch 1: obstacle 1: unknown key colour; the known ones are kind",
        ),
        (STRETCH + BUMP + BUMP.replace("first_m = 15\n", ""), "stretch 1: obstacle 2: missing first_m"),
        (STRETCH + BUMP.replace("0.05", "1"), "obstacle 1: height_m is 1, not a number from 0 to 0.15"),
        (STRETCH + BUMP.replace("bump", "log"), "obstacle 1: unknown kind 'log'; the known ones are bump"),
        (STRETCH + BUMP + "count = 2.5\n", r"obstacle 1: count is 2\.5, not a whole number"),
        (STRETCH + BUMP + "count = 5\n", "obstacle 1: 5 bump may need 135.9 m, the stretch is 100 m long"),
        (STRETCH + "profile_v_m = 1\n", "stretch 1: profile_v_m is 1, but there is no profile"),
        (PROFILE.replace('"road.csv"', "3"), "stretch 1: profile is 3, not the name of a file"),
        (PROFILE, r"stretch 1: .*road\.csv: no such file"),
        (PROFILE + "profile_v_m = 'left'\n", "stretch 1: profile_v_m is 'left', not a number"),
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
    fastest = max(stretch.speed_kmh for stretch in route.stretches if stretch.obstacles)
    for seed in range(20):
        for stretch in shuffled(route, seed).stretches:
            for obstacle in stretch.obstacles:
                assert stretch.speed_kmh <= fastest
                assert 0.6 * 0.05 <= obstacle.height_m <= 0.05


def test_shuffling_keeps_leans():
    """A stretch is leant into as before, wherever it comes to lie."""
    route = load_route("training")
    leans = [Counter((s.surface, s.lean_deg) for s in way.stretches) for way in (route, shuffled(route, 3))]
    assert leans[0] == leans[1]
