"""The rider: turns target speeds along the route into speed, place and acceleration over time.

Belongs here: longitudinal riding, gears included. Never: what the suspension makes of it.

FIDELITY: no corners and no traffic: speed changes where the route's target does. No wheel slip: the front
wheel's speed is the motorcycle's.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.plant.route import Stretch
from targets.jit import njit

GRID_M = 1.0
WANDER_KNOT_M = 60.0


class Rider(NamedTuple):
    """How hard and how evenly one lap is ridden."""

    drive_ms2: float = 2.4  # bound of the acceleration
    brake_ms2: float = 2.8  # bound of the deceleration
    pace: float = 1.0  # factor on every target speed
    wander: float = 0.04  # standard deviation of the target along the road, relative
    hand_s: float = 0.25  # first-order lag of the hand
    torque_s: float = 0.05  # first-order lag of torque at the ground
    shift_s: float = 0.15  # torque is interrupted for so long at a gear change


def target_speeds(
    stretches: tuple[Stretch, ...], rider: Rider, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Wanted speed in m/s every GRID_M metres, before the bounds on acceleration."""
    bounds = np.cumsum([stretch.length_m for stretch in stretches])
    places = np.arange(0.0, bounds[-1] + GRID_M, GRID_M)
    which = np.minimum(np.searchsorted(bounds, places, side="right"), len(stretches) - 1)
    target = np.array([stretch.speed_kmh / 3.6 for stretch in stretches])[which] * rider.pace
    knots = np.clip(rng.standard_normal(int(bounds[-1] / WANDER_KNOT_M) + 2), -2.0, 2.0)
    wander = np.interp(places, np.arange(len(knots)) * WANDER_KNOT_M, knots)
    return target * (1.0 + rider.wander * wander)


@njit(cache=True)
def follow(target: Any, rider: Rider, end_m: float, x: Any, v: Any, a: Any) -> int:
    """Ride along `target` (m/s, every metre) at 1 kHz from its first speed; return the samples written.

    x, v, a receive place (m), speed (m/s) and acceleration (m/s2). Riding stops at `end_m` or when they
    are full.
    """
    last = len(target) - 1
    # Planned with 0.8 of the bounds: the rest is for correcting. v2^2 = v1^2 + 2 a ds
    limit = target.copy()
    for i in range(last - 1, -1, -1):
        limit[i] = min(limit[i], np.sqrt(limit[i + 1] ** 2 + 2.0 * 0.8 * rider.brake_ms2))
    for i in range(last):
        limit[i + 1] = min(limit[i + 1], np.sqrt(limit[i] ** 2 + 2.0 * 0.8 * rider.drive_ms2))
    # Upshift speeds of relaxed riding (36, 58, 79, 101, 122 km/h), m/s.
    up = np.array([10.0, 16.0, 22.0, 28.0, 34.0])
    gear = 0
    while gear < len(up) and limit[0] > up[gear]:
        gear += 1
    place, speed, hand, pull, pause = 0.0, limit[0], 0.0, 0.0, 0.0
    dt = 0.001
    count = 0
    while count < len(x) and place < end_m:
        x[count], v[count], a[count] = place, speed, pull
        count += 1
        i = min(int(place + speed * (rider.hand_s + rider.torque_s)), last - 1)
        # v dv/dx of the limit ahead, and 1 m/s2 for every m/s off the limit here
        wanted = 0.5 * (limit[i + 1] ** 2 - limit[i] ** 2) + (limit[min(int(place), last)] - speed)
        wanted = min(max(wanted, -rider.brake_ms2), rider.drive_ms2)
        hand += (wanted - hand) * dt / rider.hand_s
        if pause <= 0.0:
            if gear < len(up) and speed > up[gear] and hand > 0.2:
                gear += 1
                pause = rider.shift_s
            elif gear > 0 and speed < 0.9 * up[gear - 1] and hand < 0.0:
                gear -= 1
                pause = rider.shift_s
        torque = hand
        if pause > 0.0:
            pause -= dt
            # Clutch in: no drive, drag alone; on the way down the engine brakes as it catches up.
            torque = min(hand, -0.3) if hand > 0.0 else hand - 0.5
        pull += (torque - pull) * dt / rider.torque_s
        place += speed * dt + 0.5 * pull * dt * dt
        speed = max(speed + pull * dt, 1.0)
    return count
