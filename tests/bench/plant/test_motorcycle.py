import math

import pytest

from bench.errors import RouteError
from bench.plant.dynamics import equilibrium
from bench.plant.motorcycle import FOLDER, NAMES, carrying, load_motorcycle

TEXT = (FOLDER / "gsxr1000.toml").read_text(encoding="utf-8")


def load(tmp_path, text):
    path = tmp_path / "bike.toml"
    path.write_text(text, encoding="utf-8")
    return load_motorcycle(path)


def line(key):
    return next(row for row in TEXT.splitlines() if row.startswith(f"{key} ="))


def test_default_is_a_gsxr1000():
    """The motorcycle that comes with the bench has wheelbase, mass and sensors of the test bed's class."""
    motorcycle = load_motorcycle()
    assert motorcycle.wheelbase_m == pytest.approx(1.41)
    assert 260 < motorcycle.mass_kg < 300
    assert (motorcycle.fork.sensor_range_mm, motorcycle.shock.sensor_range_mm) == (150.0, 110.0)


def test_fork_ratios_agree_with_one_rake():
    """Linkage, sensor and dive ratio of the fork all follow from the same steering angle."""
    motorcycle = load_motorcycle()
    rake = math.atan(motorcycle.dive_ratio)
    assert motorcycle.fork.linkage == pytest.approx(1 / math.cos(rake), abs=1e-3)
    assert motorcycle.fork.sensor == motorcycle.fork.linkage


def test_rear_sensor_spans_its_range_over_the_wheel_travel():
    """130 mm of rear wheel travel move the sensor by just less than its 110 mm."""
    shock = load_motorcycle().shock
    assert 105 < 1e3 * (shock.sensor + 0.5 * shock.sensor_rise_per_m * 0.13) * 0.13 < 110


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        (line("sprung_kg"), "", "missing sprung_kg"),
        (line("knee_m_per_s"), "", r"missing fork\.knee_m_per_s"),
        (line("sprung_kg"), line("sprung_kg") + "\nwheels = 2", "unknown key wheels"),
        ("[fork]", "[fork]\ncolour = 1", r"unknown key fork\.colour"),
        (line("sprung_kg"), "sprung_kg = 'heavy'", "sprung_kg is 'heavy', not a finite number"),
        (line("sprung_kg"), "sprung_kg = nan", "sprung_kg is nan, not a finite number"),
        (line("sprung_kg"), "sprung_kg = true", "sprung_kg is True, not a finite number"),
        (line("sprung_kg"), "sprung_kg = -1", "sprung_kg is -1, below zero"),
        (line("sprung_kg"), "sprung_kg = 0", "sprung_kg is 0; it must be above"),
        (line("front_brake_share"), "front_brake_share = 1.5", r"front_brake_share is 1\.5, above 1"),
        (line("topout_m"), "topout_m = 0.2", r"fork\.topout_m 0\.2 is not below bump_m"),
        (line("air_length_m"), "air_length_m = 0.1", r"fork\.air_length_m 0\.1 ends before the bump stop"),
        (TEXT, "fork = 3", "fork is 3, not a table"),
        (TEXT, "= 3", "not TOML"),
    ],
)
def test_refuses_what_is_not_physical(tmp_path, old, new, says):
    """A missing, unknown or impossible number is one line with the file, the key and the value."""
    with pytest.raises(RouteError, match=says) as refusal:
        load(tmp_path, TEXT.replace(old, new, 1))
    assert "bike.toml: " in str(refusal.value)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("name", NAMES)
def test_shipped_motorcycles_load(name):
    """Every motorcycle that comes with the bench is read by its name, and no two are the same."""
    others = [load_motorcycle(other) for other in NAMES if other != name]
    assert load_motorcycle(name) not in others


def test_every_number_says_where_it_is_from():
    """Each number of the shipped motorcycles has a comment beside it or above it in its block."""
    for name in NAMES:
        block = ""
        for row in (FOLDER / f"{name}.toml").read_text(encoding="utf-8").splitlines():
            if row.startswith("["):
                block = ""
            block = row if "#" in row else block
            assert "=" not in row or block, f"{name}: {row}"


def test_based_on_states_only_what_differs(tmp_path):
    """A motorcycle based on another has its numbers but for the ones it states."""
    heavy = load(tmp_path, 'based_on = "gsxr1000"\nsprung_kg = 230.0\n[fork]\npreload_n = 50.0\n')
    base = load_motorcycle()
    assert heavy == base._replace(sprung_kg=230.0, fork=base.fork._replace(preload_n=50.0))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('based_on = "bike.toml"', r"bike\.toml: is based on itself"),
        ('based_on = "none.toml"', r"none\.toml: cannot be read"),
        ("based_on = 3", "based_on is 3, not a motorcycle"),
        ('based_on = "vespa"', "unknown motorcycle 'vespa'|vespa: cannot be read"),
        ('based_on = "gsxr1000"\n[magneto]\nlag_s = 0', r"magneto\.lag_s is 0; it must be above"),
    ],
)
def test_refuses_bad_bases(tmp_path, text, says):
    """A base that is missing, no name or the file itself is refused in one line."""
    with pytest.raises(RouteError, match=says):
        load(tmp_path, text)


def test_unknown_name_lists_the_known_ones():
    """A name that is neither shipped nor a .toml file is refused with the shipped ones."""
    with pytest.raises(RouteError, match="unknown motorcycle 'vespa'; the known ones are gsxr1000,"):
        load_motorcycle("vespa")


def test_missing_file_is_named(tmp_path):
    """A file that does not exist is refused by name."""
    with pytest.raises(RouteError, match=r"none\.toml: cannot be read: No such file"):
        load_motorcycle(tmp_path / "none.toml")


def test_luggage_weighs_on_the_rear():
    """Luggage over the rear axle leaves the front's load as it was, and all its weight goes to the rear."""
    bare, laden = (equilibrium(carrying(load_motorcycle(), kg)) for kg in (0.0, 20.0))
    stiffness = load_motorcycle().rear_tyre.stiffness_n_per_m
    assert laden[2] == pytest.approx(bare[2])
    assert (bare[3] - laden[3]) * stiffness == pytest.approx(20 * 9.80665, rel=1e-3)


def test_luggage_moves_no_part():
    """Axles, rider and sensor stay where they are; mass and moment of inertia are the sums of both bodies."""
    bare, laden = load_motorcycle(), carrying(load_motorcycle(), 30.0)
    moved = laden.to_front_m - bare.to_front_m
    assert laden.wheelbase_m == pytest.approx(bare.wheelbase_m)
    assert laden.to_front_m - laden.body_sensor_m == pytest.approx(bare.to_front_m - bare.body_sensor_m)
    assert laden.to_rear_m - laden.rider_behind_m == pytest.approx(bare.to_rear_m - bare.rider_behind_m)
    assert laden.mass_kg == pytest.approx(bare.mass_kg + 30)
    assert laden.sprung_kg * moved == pytest.approx(30 * bare.to_rear_m)
    inertia = bare.pitch_inertia_kgm2 + bare.sprung_kg * moved**2 + 30 * laden.to_rear_m**2
    assert laden.pitch_inertia_kgm2 == pytest.approx(inertia)


def test_no_luggage():
    """Without any the motorcycle is the same to the bit."""
    assert carrying(load_motorcycle(), 0.0) == load_motorcycle()


@pytest.mark.parametrize("load_kg", [-1.0, 251.0, math.nan, math.inf])
def test_impossible_luggage(load_kg):
    """A load below zero, beyond what a frame bears, or no number is refused."""
    with pytest.raises(RouteError, match=r"a load of .* kg is not from 0 to 250 kg"):
        carrying(load_motorcycle(), load_kg)
