import numpy as np
import pytest

from bench.plant.rider import Rider, follow, target_speeds
from bench.plant.route import Stretch

RIDER = Rider()
STEADY = Rider(wander=0.0)


def go(speeds_mps, rider=RIDER, samples=200_000):
    target = np.array(speeds_mps, dtype=float)
    x, v, a = np.empty(samples), np.empty(samples), np.empty(samples)
    count = follow(target, rider, len(target) - 1.0, x, v, a)
    return x[:count], v[:count], a[:count]


def test_constant_target_is_ridden_constantly():
    """Along one target speed nothing is done to it."""
    _, v, a = go([15.0] * 500)
    assert np.ptp(v) < 1e-9
    assert np.all(a == 0)


def test_place_and_speed_are_integrals():
    """Place is the integral of speed and speed that of acceleration."""
    x, v, a = go([10.0] * 200 + [25.0] * 400 + [8.0] * 200)
    assert np.diff(v) == pytest.approx(a[1:] * 0.001, abs=1e-9)
    assert np.diff(x) == pytest.approx((v[:-1] + v[1:]) * 0.0005, abs=1e-8)


def test_acceleration_and_braking_stay_in_bounds():
    """Between any speeds acceleration never passes the rider's bounds."""
    _, _, a = go([10.0] * 200 + [40.0] * 800 + [5.0] * 300)
    assert a.max() <= RIDER.drive_ms2
    assert a.max() > 0.6 * RIDER.drive_ms2
    # engine braking in a downshift comes on top
    assert -RIDER.brake_ms2 - 0.5 <= a.min() < -0.6 * RIDER.brake_ms2


def test_slow_stretches_are_met_at_their_speed():
    """The rider has slowed down when a slow stretch begins, within 1 km/h."""
    x, v, _ = go([25.0] * 400 + [8.0] * 100)
    assert np.interp(401.0, x, v) == pytest.approx(8.0, abs=0.3)


def test_targets_are_reached():
    """Well into a stretch its speed is ridden."""
    _, v, _ = go([10.0] * 100 + [25.0] * 900)
    assert v[-1] == pytest.approx(25.0, abs=0.2)


def test_gear_changes_interrupt_the_drive():
    """Accelerating through two shift points, the drive is gone twice and comes back."""
    _, v, a = go([8.0] * 50 + [18.0] * 300)
    pulling = v < 17.0
    gone = (a < 0) & pulling & (np.arange(len(a)) > 1000)
    assert np.count_nonzero(np.diff(gone.astype(int)) == 1) == 2


def test_changing_down_brakes_harder_for_a_moment():
    """Slowing through shift points, the engine's braking comes on top of the rider's, 0.15 s at a time."""
    _, v, a = go([25.0] * 200 + [8.0] * 200)
    steady = np.median(a[(v > 10.0) & (v < 22.0)])
    jerks = (a < steady - 0.3) & (v > 8.5) & (v < 22.0)
    starts = np.flatnonzero(np.diff(jerks.astype(int)) == 1)
    assert len(starts) == 3
    assert np.count_nonzero(jerks) / len(starts) == pytest.approx(150, abs=60)


def test_targets_wander_by_what_the_rider_says():
    """Target speeds scatter about the stretch's by the rider's wander, and not at all without it."""
    stretches = (Stretch("urban", 50_000, 50),)
    wandering = target_speeds(stretches, RIDER, np.random.default_rng(0)) / (50 / 3.6)
    assert wandering.mean() == pytest.approx(1.0, abs=0.01)
    assert np.abs(wandering - 1).max() <= 2.001 * RIDER.wander
    assert wandering.std() > 0.5 * RIDER.wander
    steady = target_speeds(stretches, STEADY, np.random.default_rng(0))
    assert np.ptp(steady) == 0.0


def test_riding_stops_when_the_room_is_full():
    """With room for fewer samples than the route takes, exactly those are written."""
    x, _, _ = go([10.0] * 500, samples=1000)
    assert len(x) == 1000
