import numpy as np
import pytest

from bench.plant.dynamics import (
    COLUMNS,
    GRAVITY_M_PER_S2,
    current_for,
    simulate,
    sky_hook,
    tyre_force,
    wheel_force,
    yield_force,
)
from bench.plant.motorcycle import NAMES, load_motorcycle

BIKE = load_motorcycle()
MAGNETO = load_motorcycle("gsxr1000_magneto")
STEP_M = 0.02


def drive(
    height,
    speed_mps=10.0,
    seconds=4.0,
    push=0.0,
    moment=0.0,
    substeps=2,
    weight=1.0,
    damper=1.0,
    bike=BIKE,
):
    """Run at constant speed over `height(x)`; forces act from 1 s on. Returns column name -> samples."""
    x = np.arange(round(seconds * 1000)) * 0.001 * speed_mps
    road = height(np.arange(0.0, x[-1] + 4.0, STEP_M))
    on = x >= speed_mps * 1.0
    one = np.ones(len(x))
    way = np.stack([x, speed_mps * one, push * on, moment * on, weight * one, damper * one])
    out = simulate(bike, road, STEP_M, way, substeps=substeps)
    return dict(zip(COLUMNS, out.T, strict=True))


def flat(x):
    return np.zeros(len(x))


def bump(x, at=12.0, high=0.05, long=0.9):
    u = np.clip((x - at) / (long / 2), -1, 1)
    return high * (1 - u * u) ** 2


def rough(x, seed=0, slope=0.02):
    walk = np.cumsum(np.random.default_rng(seed).standard_normal(len(x))) * slope * STEP_M * 5
    walk = np.convolve(walk, np.ones(8) / 8, "same")
    return np.where(x < 3.0, 0.0, walk - walk[np.searchsorted(x, 3.0)])


def test_rest_is_rest():
    """On a flat road without forces nothing moves by a micrometre in four seconds."""
    out = drive(flat)
    assert np.ptp(out["fork_stroke_mm"]) < 1e-3
    assert np.ptp(out["rear_stroke_mm"]) < 1e-3


@pytest.mark.parametrize("name", NAMES)
def test_static_sag_is_the_force_balance(name):
    """At rest springs and air, by the lever of each end, carry body and rider about the axles."""
    bike = load_motorcycle(name)
    out = drive(flat, seconds=0.01, bike=bike)
    rider = bike.rider_kg * (bike.to_rear_m - bike.rider_behind_m)
    front = (bike.sprung_kg * bike.to_rear_m + rider) / bike.wheelbase_m
    loads = front, bike.sprung_kg + bike.rider_kg - front
    for strut, column, load in zip((bike.fork, bike.shock), COLUMNS, loads, strict=False):
        a, b = strut.sensor_rise_per_m / 2, strut.sensor
        stroke = out[column][0] / 1e3
        wheel = stroke / b if a == 0 else (-b + np.sqrt(b * b + 4 * a * stroke)) / (2 * a)
        u = strut.linkage * wheel + strut.linkage_rise_per_m * wheel**2 / 2
        air = (strut.air_length_m / (strut.air_length_m - u)) ** strut.air_exponent - 1
        force = strut.preload_n + strut.spring_n_per_m * u + strut.air_n * air
        lever = strut.linkage + strut.linkage_rise_per_m * wheel
        assert force * lever == pytest.approx(load * GRAVITY_M_PER_S2, rel=1e-6)


def test_tyres_carry_the_whole_weight():
    """At rest both tyre forces together are the weight of the motorcycle."""
    out = drive(flat, seconds=0.01)
    total = out["front_tyre_n"][0] + out["rear_tyre_n"][0]
    assert total == pytest.approx(BIKE.mass_kg * GRAVITY_M_PER_S2, rel=1e-9)


def test_returns_to_rest_after_a_bump():
    """Three seconds after a bump the strokes are back at their sag."""
    out = drive(bump, seconds=5.0)
    for name in ("fork_stroke_mm", "rear_stroke_mm"):
        assert np.ptp(out[name]) > 10
        assert out[name][-1] == pytest.approx(out[name][0], abs=0.1)


def test_halving_the_step_changes_little():
    """With half the step strokes on a rough road and a bump differ by less than 0.05 mm rms."""

    def road(x):
        return rough(x) + bump(x, at=30.0)

    one, half = drive(road, seconds=10.0), drive(road, seconds=10.0, substeps=4)
    for name in ("fork_stroke_mm", "rear_stroke_mm"):
        assert one[name].std() > 3
        assert np.sqrt(np.mean((one[name] - half[name]) ** 2)) < 0.05


def braking(deceleration=3.0):
    force = -BIKE.mass_kg * deceleration
    return {"push": force, "moment": force * BIKE.height_m}


def test_braking_dives():
    """Braking compresses the fork, extends the rear and pitches nose down, which is positive."""
    out = drive(flat, **braking())
    assert out["fork_stroke_mm"][-1] > out["fork_stroke_mm"][0] + 15
    assert out["rear_stroke_mm"][-1] < out["rear_stroke_mm"][0] - 10
    assert out["pitch_rate_dps"].sum() * 0.001 > 1.0


def test_acceleration_squats_less_than_braking_dives():
    """Driving extends the fork and compresses the rear, the latter held back by chain and swingarm."""
    out = drive(flat, push=BIKE.mass_kg * 3.0, moment=BIKE.mass_kg * 3.0 * BIKE.height_m)
    assert out["fork_stroke_mm"][-1] < out["fork_stroke_mm"][0] - 5
    assert 0 < out["rear_stroke_mm"][-1] - out["rear_stroke_mm"][0] < 15
    assert out["pitch_rate_dps"].sum() < 0


def test_load_transfer_is_the_textbooks():
    """Steady braking moves m a h / wheelbase newtons from the rear tyre to the front one."""
    out = drive(flat, **braking())
    transfer = BIKE.mass_kg * 3.0 * BIKE.height_m / BIKE.wheelbase_m
    assert out["front_tyre_n"][-1] - out["front_tyre_n"][0] == pytest.approx(transfer, rel=1e-3)
    assert out["rear_tyre_n"][-1] - out["rear_tyre_n"][0] == pytest.approx(-transfer, rel=1e-3)


def test_equilibrium_of_steady_braking_is_where_the_motion_ends():
    """The equilibrium computed for braking is the one the simulation settles in."""
    settled = drive(flat, seconds=6.0, **braking())
    force = np.full(10, braking()["push"])
    zero, one = np.zeros(10), np.ones(10)
    way = np.stack([zero, zero, force, force * BIKE.height_m, one, one])
    out = simulate(BIKE, np.zeros(300), STEP_M, way)
    assert settled["fork_stroke_mm"][-1] == pytest.approx(out[0, 0], abs=0.02)
    assert settled["rear_stroke_mm"][-1] == pytest.approx(out[0, 1], abs=0.02)


def test_a_steady_slope_does_not_work_the_suspension():
    """Climbing 5 % steadily, strokes return to those on the level."""
    out = drive(lambda x: 0.05 * np.clip(x - 5.0, 0, None), seconds=6.0)
    assert out["fork_stroke_mm"][-1] == pytest.approx(out["fork_stroke_mm"][0], abs=0.05)
    assert out["rear_stroke_mm"][-1] == pytest.approx(out["rear_stroke_mm"][0], abs=0.05)
    # nose up by 0.05 rad, and pitch is positive nose down
    assert out["pitch_rate_dps"].sum() * 0.001 == pytest.approx(-np.degrees(0.05), abs=0.05)


@pytest.mark.parametrize("speed_mps", [8.0, 14.0, 25.0])
def test_the_rear_wheel_follows_by_wheelbase_over_speed(speed_mps):
    """The rear wheel's acceleration is the front's, later by wheelbase over speed."""
    out = drive(rough, speed_mps=speed_mps, seconds=8.0)
    front, rear = out["acc_front_ms2"], out["acc_rear_ms2"]
    lags = np.arange(10, 300)
    match = [np.dot(front[: -lag or None], rear[lag:]) for lag in lags]
    assert lags[np.argmax(match)] == pytest.approx(1000 * BIKE.wheelbase_m / speed_mps, abs=4)


def test_wheels_lift_off_and_the_road_never_pulls():
    """Over a sharp ramp at speed both tyres leave the road, and no tyre force is ever negative."""
    out = drive(lambda x: bump(x, high=0.12, long=1.2), speed_mps=15.0)
    for name in ("front_tyre_n", "rear_tyre_n"):
        assert out[name].min() == 0.0


def test_a_wheel_in_the_air_falls_or_is_pushed_down():
    """Without tyre force the wheel accelerates downwards at gravity or more: the strut only pushes it."""
    out = drive(lambda x: bump(x, high=0.12, long=1.2), speed_mps=15.0)
    airborne = out["front_tyre_n"] == 0.0
    inside = out["fork_stroke_mm"] > 1e3 * BIKE.fork.topout_m
    slow = (
        np.abs(np.gradient(out["fork_stroke_mm"])) < 0.1
    )  # 100 mm/s: the damper pulls less than springs push
    assert np.any(airborne & inside & slow)
    assert out["acc_front_ms2"][airborne & inside & slow].max() < -GRAVITY_M_PER_S2


@pytest.mark.parametrize("speed", [-3.0, -0.5, 0.0, 0.5, 3.0])
def test_tyre_in_the_air_has_no_force(speed):
    """A tyre that does not touch pushes with nothing, however it moves; in contact it never pulls."""
    assert tyre_force(BIKE.front_tyre, -0.001, speed) == 0.0
    assert tyre_force(BIKE.front_tyre, -0.001, -100.0) == 0.0
    assert tyre_force(BIKE.front_tyre, 0.001, -100.0) == 0.0
    assert tyre_force(BIKE.front_tyre, 0.005, speed) > 0.0


@pytest.mark.parametrize("strut", [BIKE.fork, BIKE.shock], ids=["fork", "shock"])
def test_springs_stiffen_over_their_travel(strut):
    """Wheel force grows with travel, faster towards the bump stop, and holds the wheel at top-out."""
    travel = np.linspace(0.0, 0.125, 200)
    force = np.array([wheel_force(strut, w, 0.0) for w in travel])
    rate = np.diff(force)
    assert np.all(rate > 0)
    assert rate[-1] > 3 * rate[100] > 3 * rate[60]
    assert force[0] < 0


@pytest.mark.parametrize("strut", [BIKE.fork, BIKE.shock], ids=["fork", "shock"])
def test_dampers_resist_rebound_more_and_are_digressive(strut):
    """Damping always resists, rebound harder than compression, and grows less than proportionally."""

    def damping(speed):
        return wheel_force(strut, 0.05, speed) - wheel_force(strut, 0.05, 0.0)

    assert damping(0.5) > 0 > damping(-0.5)
    assert -damping(-0.5) > 1.5 * damping(0.5)
    assert damping(1.0) < 1.9 * damping(0.5)


def test_leaning_weighs_the_motorcycle_down():
    """With 10 % more weight along the frame both strokes sink, and the tyres carry 10 % more."""
    upright, leaning = drive(flat, seconds=0.01), drive(flat, seconds=0.01, weight=1.1)
    for name in ("front_tyre_n", "rear_tyre_n"):
        assert leaning[name][0] == pytest.approx(1.1 * upright[name][0], rel=0.02)
    for name in ("fork_stroke_mm", "rear_stroke_mm"):
        assert 1 < leaning[name][0] - upright[name][0] < 10


def test_warm_oil_damps_less():
    """With the dampers' oil at 0.7 of its damping the strokes move faster on a rough road."""
    cold, warm = drive(rough, seconds=8.0), drive(rough, seconds=8.0, damper=0.7)
    for name in ("fork_stroke_mm", "rear_stroke_mm"):
        assert np.gradient(warm[name]).std() > 1.05 * np.gradient(cold[name]).std()


def test_the_seat_changes_what_a_bump_does_not_the_sag():
    """A rider on a stiff seat loads the motorcycle alike at rest, and moves it otherwise over a bump."""
    stiff = BIKE._replace(rider_hz=25.0, rider_damping=1.0)
    soft, hard = (drive(bump, bike=bike)["rear_stroke_mm"] for bike in (BIKE, stiff))
    assert soft[0] == pytest.approx(hard[0], abs=1e-6)
    assert np.abs(soft - hard).max() > 1


@pytest.mark.parametrize("amperes", [0.1, 0.5, 1.0, 2.0])
def test_yield_force_and_current_are_each_others_inverse(amperes):
    """The current for a yield force gives that force back; 2 A give the full one."""
    assert current_for(MAGNETO.fork, yield_force(MAGNETO.fork, amperes)) == pytest.approx(amperes)
    assert yield_force(MAGNETO.fork, 2.0) == pytest.approx(MAGNETO.fork.mr_full_n)


def test_current_stays_between_a_tenth_and_two_amperes():
    """Whatever is wanted, the current is 0.1 A to 2 A (section I.4), and both are reached on a rough road."""
    out = drive(rough, seconds=8.0, bike=MAGNETO)
    for name in ("front_a", "rear_a"):
        assert 0.1 <= out[name].min() < 0.11
        assert 0.5 < out[name].max() <= 2.0


def test_sky_hook_only_works_where_the_damper_can():
    """Where the damper would push the body the way it already goes, it gets the least current."""
    assert sky_hook(MAGNETO.fork, 0.05, 0.3, 0.4, 1400.0) == 0.1
    assert sky_hook(MAGNETO.fork, 0.05, -0.3, 0.4, 1400.0) > 0.5


def test_more_current_holds_harder():
    """At a given speed the wheel force of a magnetorheological strut grows with the current."""
    forces = [wheel_force(MAGNETO.shock, 0.06, 0.2, amperes) for amperes in (0.1, 0.5, 1.0, 2.0)]
    assert np.all(np.diff(forces) > 100)


def test_the_magneto_kit_calms_the_body():
    """With sky-hook control the body moves less on a rough road than with the least current throughout."""
    off = MAGNETO._replace(magneto=MAGNETO.magneto._replace(sky_front_ns_per_m=0.0, sky_rear_ns_per_m=0.0))
    on, least = (drive(rough, seconds=10.0, bike=bike)["pitch_rate_dps"].std() for bike in (MAGNETO, off))
    assert on < 0.97 * least


def test_air_springs_stiffen_with_their_exponent():
    """A polytropic air column pushes harder than an isothermal one, and both by their formulas."""
    strut = load_motorcycle("sport_tourer").shock._replace(preload_n=0.0, spring_n_per_m=1e-9, friction_n=0.0)
    u = 0.02
    w = 0.04
    strut = strut._replace(linkage=0.5, linkage_rise_per_m=1e-12)
    for exponent in (1.0, 1.3):
        force = wheel_force(strut._replace(air_exponent=exponent), w, 0.0) / 0.5
        expected = strut.air_n * ((strut.air_length_m / (strut.air_length_m - u)) ** exponent - 1)
        assert force == pytest.approx(expected, rel=1e-6)
