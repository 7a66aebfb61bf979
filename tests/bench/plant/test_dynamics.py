import numpy as np
import pytest

from bench.plant.dynamics import (
    COLUMNS,
    GRAVITY_M_PER_S2,
    accelerate,
    equilibrium,
    simulate,
    tyre_force,
    wheel_force,
)
from bench.plant.motorcycle import load_motorcycle

BIKE = load_motorcycle()
STEP_M = 0.02


def drive(height, speed_mps=10.0, seconds=4.0, push=0.0, moment=0.0, substeps=2):
    """Run at constant speed over `height(x)`; forces act from 1 s on. Returns column name -> samples."""
    x = np.arange(round(seconds * 1000)) * 0.001 * speed_mps
    road = height(np.arange(0.0, x[-1] + 4.0, STEP_M))
    on = x >= speed_mps * 1.0
    out = simulate(
        BIKE, road, STEP_M, x, np.full(len(x), speed_mps), push * on, moment * on, substeps=substeps
    )
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


def test_static_sag_is_the_force_balance():
    """At rest the springs, by Hooke's law and the lever of each end, carry the body's weight share."""
    out = drive(flat, seconds=0.01)
    weight = BIKE.sprung_kg * GRAVITY_M_PER_S2
    u = out["fork_stroke_mm"][0] / 1e3
    fork = BIKE.fork.preload_n + BIKE.fork.spring_n_per_m * u
    fork += BIKE.fork.air_n * (BIKE.fork.air_length_m / (BIKE.fork.air_length_m - u) - 1)
    assert fork * BIKE.fork.linkage == pytest.approx(weight * BIKE.to_rear_m / BIKE.wheelbase_m, rel=1e-6)
    a, b = BIKE.shock.sensor_rise_per_m / 2, BIKE.shock.sensor
    wheel = (-b + np.sqrt(b * b + 4 * a * out["rear_stroke_mm"][0] / 1e3)) / (2 * a)
    travel = BIKE.shock.linkage * wheel + BIKE.shock.linkage_rise_per_m * wheel**2 / 2
    shock = BIKE.shock.preload_n + BIKE.shock.spring_n_per_m * travel
    lever = BIKE.shock.linkage + BIKE.shock.linkage_rise_per_m * wheel
    assert shock * lever == pytest.approx(weight * BIKE.to_front_m / BIKE.wheelbase_m, rel=1e-6)


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


def test_natural_frequencies_are_a_motorcycles():
    """Linearised about rest: heave 1.5-2.5 Hz, pitch 2.5-4 Hz, wheel hop 12-18 Hz, every mode damped."""

    def slope(state):
        dy = np.zeros(10)
        accelerate(BIKE, state, np.zeros(4), 0.0, 0.0, dy)
        return dy[:8]

    rest, h = equilibrium(BIKE), 1e-6
    matrix = np.array([(slope(rest + h * e) - slope(rest - h * e)) / (2 * h) for e in np.eye(8)]).T
    hertz = np.sort(np.sqrt(np.linalg.eigvals(-matrix[4:, :4]).real)) / (2 * np.pi)
    low, high = np.array([1.5, 2.5, 12, 12]), np.array([2.5, 4, 18, 18])
    assert np.all((hertz > low) & (hertz < high)), hertz
    assert np.linalg.eigvals(matrix).real.max() < 0


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
    out = simulate(BIKE, np.zeros(300), STEP_M, np.zeros(10), np.zeros(10), force, force * BIKE.height_m)
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
