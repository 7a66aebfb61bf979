"""One simulated lap: route, rider, road and motorcycle put together; all seven channels at 1 kHz."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.errors import RouteError
from bench.laps.lap import Lap
from bench.plant.dynamics import COLUMNS, GRAVITY_M_PER_S2, simulate
from bench.plant.motorcycle import Motorcycle, Strut
from bench.plant.rider import GRID_M, Rider, follow, target_speeds
from bench.plant.road import STEP_M, Road, build_road
from bench.plant.route import Route, Stretch, checked_seed, shuffled

SAMPLE_NS = 1_000_000
LONGEST_S = 7200  # what fits in memory with room to spare; longer campaigns ride more laps

# What differs from lap to lap and no channel shows: standard deviations, cut at two of them. Small on
# purpose: a load of 3 kg moves the mean rear stroke by about 1 mm, and a soft sensor that sees fork stroke,
# pitch rate and speed has to live with that, as on a real motorcycle.
LOAD_KG = 1.5
DAMPER = 0.015
PACE = 0.02
HANDS = 0.1  # of acceleration and braking


class Longitudinal(NamedTuple):
    """What the rider did, at 1 kHz: rear wheel's place on the route (m), speed (m/s), acceleration (m/s2)."""

    x_m: NDArray[np.float64]
    v_mps: NDArray[np.float64]
    a_mps2: NDArray[np.float64]


def ride(route: Route, motorcycle: Motorcycle, seed: int, seconds: float | None = None) -> Lap:
    """Ride a route once, or for `seconds` (round and round, cut there).

    The same arguments give the same bytes. Pitch rate is positive nose down (II.1); strokes grow under
    compression; accelerations are vertical and kinematic (zero at rest), the body's on the steering head.
    FIDELITY: true values, no sensor between; no engine vibration.
    Raises RouteError for a negative seed, a length that is no time, or a stroke beyond its sensor's range.
    """
    seed = checked_seed(seed)
    if seconds is not None and not 0.002 <= seconds <= LONGEST_S:
        raise RouteError(f"a lap of {seconds:g} s is not from 0.002 to {LONGEST_S} s")
    if route.nominal_s > LONGEST_S:
        raise RouteError(f"route {route.name} takes {route.nominal_s:.0f} s, more than {LONGEST_S} s")
    if route.shuffle:
        route = shuffled(route, seed)
    hidden, riding, roads = np.random.SeedSequence(seed).spawn(3)
    draw = np.clip(np.random.Generator(np.random.PCG64(hidden)).standard_normal(5), -2.0, 2.0)
    motorcycle = vary(motorcycle, load_kg=LOAD_KG * draw[0], damper=1.0 + DAMPER * draw[1])
    rider = Rider(
        pace=1.0 + PACE * draw[2],
        drive_ms2=2.4 * (1.0 + HANDS * draw[3]),
        brake_ms2=2.8 * (1.0 + HANDS * draw[4]),
    )
    stretches = route.stretches
    if seconds is not None:
        # The pace is at most 4 % up and the target at most 8 %: so many rounds cannot end early.
        stretches *= math.ceil((seconds + 1.0) * 1.15 / route.nominal_s)
    rng = np.random.Generator(np.random.PCG64(riding))
    way = _longitudinal(stretches, rider, rng, seconds)
    out = _suspension(motorcycle, build_road(stretches, roads), way)
    _check(route, motorcycle, out)
    channels = {name: out[:, k] for k, name in enumerate(COLUMNS) if not name.endswith("tyre_n")}
    channels["speed_kmh"] = way.v_mps * 3.6
    t_ns = np.arange(len(out), dtype=np.int64) * SAMPLE_NS
    return Lap(t_ns, channels, source=f"{route.name} seed {seed}")


def vary(motorcycle: Motorcycle, load_kg: float, damper: float) -> Motorcycle:
    """The motorcycle with `load_kg` more on the body and both dampers' constants times `damper`."""
    return motorcycle._replace(
        sprung_kg=motorcycle.sprung_kg + load_kg,
        fork=_warm(motorcycle.fork, damper),
        shock=_warm(motorcycle.shock, damper),
    )


def _warm(strut: Strut, damper: float) -> Strut:
    return strut._replace(
        compression_ns_per_m=strut.compression_ns_per_m * damper,
        compression_fast_ns_per_m=strut.compression_fast_ns_per_m * damper,
        rebound_ns_per_m=strut.rebound_ns_per_m * damper,
        rebound_fast_ns_per_m=strut.rebound_fast_ns_per_m * damper,
    )


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


def _suspension(motorcycle: Motorcycle, road: Road, way: Longitudinal) -> NDArray[np.float64]:
    m = motorcycle
    drag = m.drag_n_per_m2s2 * way.v_mps**2
    # What inertia and grade ask of the tyres; with h and the drag's height it is the load transfer.
    inertia = m.mass_kg * (way.a_mps2 + GRAVITY_M_PER_S2 * road.grade_at(way.x_m))
    moment = inertia * m.height_m + drag * m.drag_height_m
    return simulate(m, road.height_m, STEP_M, way.x_m, way.v_mps, inertia + drag, moment)


def _check(route: Route, motorcycle: Motorcycle, out: NDArray[np.float64]) -> None:
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
