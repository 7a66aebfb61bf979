"""One simulated lap: route, rider, road and motorcycle put together; all seven channels at 1 kHz."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.errors import RouteError
from bench.laps.lap import Lap
from bench.plant.dynamics import COLUMNS, DEGREES_PER_RADIAN, GRAVITY_M_PER_S2, SUBSTEPS, simulate
from bench.plant.hidden import draw, lean, loaded, oil, posture
from bench.plant.motorcycle import Motorcycle
from bench.plant.rider import GRID_M, Rider, follow, target_speeds
from bench.plant.road import STEP_M, Road, build_road
from bench.plant.route import Route, Stretch, checked_seed, shuffled
from dbc import CHANNELS

SAMPLE_NS = 1_000_000
LONGEST_S = 7200  # what fits in memory with room to spare; longer campaigns ride more laps


class Longitudinal(NamedTuple):
    """What the rider did, at 1 kHz: rear wheel's place on the route (m), speed (m/s), acceleration (m/s2)."""

    x_m: NDArray[np.float64]
    v_mps: NDArray[np.float64]
    a_mps2: NDArray[np.float64]


def ride(
    route: Route,
    motorcycle: Motorcycle,
    seed: int,
    seconds: float | None = None,
    substeps: int = SUBSTEPS,
) -> Lap:
    """Ride a route once, or for `seconds` (round and round, cut there).

    The same arguments give the same bytes. Pitch rate is the frame's, positive nose down (II.1); strokes grow
    as struts shorten; accelerations are vertical and kinematic, 0 at rest, the body's at the steering head.
    FIDELITY: true values, no sensor between; no engine vibration.
    Raises RouteError for a negative seed, a length that is no time, a speed beyond a tyre's rating, and a
    stroke beyond its sensor's range.
    """
    seed = checked_seed(seed)
    if seconds is not None and not 0.002 <= seconds <= LONGEST_S:
        raise RouteError(f"a lap of {seconds:g} s is not from 0.002 to {LONGEST_S} s")
    if route.nominal_s > LONGEST_S:
        raise RouteError(f"route {route.name} takes {route.nominal_s:.0f} s, more than {LONGEST_S} s")
    if route.shuffle:
        route = shuffled(route, seed)
    seeds = np.random.SeedSequence(seed).spawn(5)
    hidden = draw(seeds[0])
    motorcycle = loaded(motorcycle, hidden)
    stretches = route.stretches
    if seconds is not None:
        # The pace is at most 4 % up and the target at most 8 %: so many rounds cannot end early.
        stretches *= math.ceil((seconds + 1.0) * 1.15 / route.nominal_s)
    riding, bends, body = (np.random.Generator(np.random.PCG64(s)) for s in (seeds[1], seeds[3], seeds[4]))
    way = _longitudinal(stretches, hidden.rider, riding, seconds)
    _check_speed(route, motorcycle, way)
    road = build_road(stretches, seeds[2])
    lean_rad = lean(stretches, way.x_m, bends)
    samples = len(way.x_m)
    rows = _rows(motorcycle, road, way, lean_rad, posture(motorcycle, samples, body), oil(hidden, samples))
    out = simulate(motorcycle, road.height_m, STEP_M, rows, substeps)
    _check_strokes(route, motorcycle, out)
    channels = {name: out[:, COLUMNS.index(name)] for name in CHANNELS if name != "speed_kmh"}
    channels["speed_kmh"] = way.v_mps * 3.6
    # In a steady turn the frame yaws by g tan(lean) / v; sin(lean) of it is about the frame's own pitch axis.
    yaw = GRAVITY_M_PER_S2 * np.tan(lean_rad) / np.maximum(way.v_mps, 3.0)
    channels["pitch_rate_dps"] = channels["pitch_rate_dps"] - DEGREES_PER_RADIAN * yaw * np.sin(lean_rad)
    t_ns = np.arange(len(out), dtype=np.int64) * SAMPLE_NS
    return Lap(t_ns, channels, source=f"{route.name} seed {seed}")


def _longitudinal(
    stretches: tuple[Stretch, ...], rider: Rider, rng: np.random.Generator, seconds: float | None
) -> Longitudinal:
    target = target_speeds(stretches, rider, rng)
    if seconds is None:
        # Time at the targets, and what a change from 200 to 10 km/h and back costs at each border.
        samples = int(1000.0 * (1.1 * GRID_M * float(np.sum(1.0 / target)) + 25.0 * (len(stretches) + 1)))
    else:
        samples = round(seconds * 1000.0)
    x, v, a = np.empty(samples), np.empty(samples), np.empty(samples)
    length_m = sum(stretch.length_m for stretch in stretches)
    count = follow(target, rider, length_m, x, v, a)
    return Longitudinal(x[:count], v[:count], a[:count])


def _rows(
    motorcycle: Motorcycle,
    road: Road,
    way: Longitudinal,
    lean_rad: NDArray[np.float64],
    moment_nm: NDArray[np.float64],
    damper: NDArray[np.float64],
) -> NDArray[np.float64]:
    """What `simulate` is driven with: (6, samples), rows as in its WAY; moment_nm comes on top, nose up."""
    m = motorcycle
    drag = m.drag_n_per_m2s2 * way.v_mps**2
    # What inertia and grade ask of the tyres; with h and the drag's height it is the load transfer.
    inertia = m.mass_kg * (way.a_mps2 + GRAVITY_M_PER_S2 * road.grade_at(way.x_m))
    moment = inertia * m.height_m + drag * m.drag_height_m + moment_nm
    # Leaning in a steady turn, gravity and centrifugal force add up along the frame to g / cos(lean).
    weight = 1.0 / np.cos(lean_rad)
    return np.stack([way.x_m, way.v_mps, inertia + drag, moment, weight, damper])


def _check_speed(route: Route, motorcycle: Motorcycle, way: Longitudinal) -> None:
    fastest = 3.6 * float(way.v_mps.max())
    for name, tyre in (("front_tyre", motorcycle.front_tyre), ("rear_tyre", motorcycle.rear_tyre)):
        if fastest > tyre.fastest_kmh:
            raise RouteError(
                f"{route.name}: {fastest:.0f} km/h is beyond the tyre model: {name}.fastest_kmh is "
                f"{tyre.fastest_kmh:g}"
            )


def _check_strokes(route: Route, motorcycle: Motorcycle, out: NDArray[np.float64]) -> None:
    for column, strut in enumerate((motorcycle.fork, motorcycle.shock)):
        stroke = out[:, column]
        # not (inside) rather than outside: a run that blew up holds NaN
        bad = np.flatnonzero(~((stroke >= 0.0) & (stroke <= strut.sensor_range_mm)))
        if bad.size:
            k = int(bad[0])
            raise RouteError(
                f"{route.name}: {COLUMNS[column]} is {stroke[k]:.1f} at {k / 1000:.3f} s, outside "
                f"0-{strut.sensor_range_mm:g} mm: too rough or too fast for this motorcycle"
            )
