"""How a motorcycle moves in the small: its modes from the equations, and the same found in simulated motion.

Belongs here: linearisation, identification, sag, dive. Never: printing them.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.plant.dynamics import (
    COLUMNS,
    DEGREES_PER_RADIAN,
    GRAVITY_M_PER_S2,
    SPEED,
    STATE,
    accelerate,
    equilibrium,
    integrate,
    simulate,
)
from bench.plant.motorcycle import Motorcycle

STEP_M = 0.02


class Mode(NamedTuple):
    """One mode: undamped natural frequency, damping ratio, and the part that moves most in it."""

    name: str
    hz: float
    damping: float


PARTS = ("heave", "pitch", "front wheel", "rear wheel", "rider")


def without_seals(motorcycle: Motorcycle) -> Motorcycle:
    """The motorcycle without seal friction, whose slope at rest would hide the dampers."""
    return motorcycle._replace(
        fork=motorcycle.fork._replace(friction_n=0.0), shock=motorcycle.shock._replace(friction_n=0.0)
    )


def linearised(motorcycle: Motorcycle) -> NDArray[np.float64]:
    """State matrix (10, 10) about rest, by central differences of the equations of motion."""
    steady = np.array([0.0, 0.0, 0.0, 0.0, 1.0, 1.0])
    rest, h = equilibrium(motorcycle), 1e-7

    def slope(state: NDArray[np.float64]) -> NDArray[np.float64]:
        dy = np.zeros(STATE + 2)
        accelerate(motorcycle, state, np.zeros(4), steady, dy)
        return dy[: 2 * SPEED]

    unit = np.eye(STATE)[: 2 * SPEED]
    return np.array([(slope(rest + h * e) - slope(rest - h * e)) / (2.0 * h) for e in unit]).T


def modes(motorcycle: Motorcycle) -> list[Mode]:
    """Modes of the linearised motorcycle, by rising frequency; an overdamped one appears as two."""
    values, vectors = np.linalg.eig(linearised(motorcycle))
    return _named(motorcycle, values, vectors)


def identified(motorcycle: Motorcycle, displaced: float = 1e-6, samples: int = 5) -> list[Mode]:
    """Modes found in the simulated motion: what becomes of small displacements from rest within milliseconds.

    Every state in turn is displaced by `displaced` (m, rad, m/s, rad/s) and left to the integrator on a flat
    road; the columns of what comes of it are the transition matrix, whose logarithm has the modes.
    """
    way = np.zeros((6, samples))
    way[4], way[5] = 1.0, 1.0
    rest = equilibrium(motorcycle)
    out = np.empty((samples, len(COLUMNS)))
    columns = []
    for unit in np.eye(STATE)[: 2 * SPEED]:
        ends = []
        for sign in (1.0, -1.0):
            state = rest + sign * displaced * unit
            integrate(motorcycle, state, np.zeros(300), 1.0 / STEP_M, way, 8, out)
            ends.append(state[: 2 * SPEED])
        columns.append((ends[0] - ends[1]) / (2.0 * displaced))
    values, vectors = np.linalg.eig(np.array(columns).T)
    return _named(motorcycle, np.log(values.astype(complex)) / (0.001 * samples), vectors)


def _named(
    motorcycle: Motorcycle, values: NDArray[np.complex128], vectors: NDArray[np.complex128]
) -> list[Mode]:
    # metres against metres: pitch counts at half the wheelbase, the rider against the seat
    size = np.abs(vectors[:SPEED]) * np.array([1.0, motorcycle.wheelbase_m / 2.0, 1.0, 1.0, 1.0])[:, None]
    size[4] = np.abs(vectors[4] - vectors[0] - motorcycle.rider_behind_m * vectors[1])
    found = [
        Mode(PARTS[int(part)], float(abs(value)) / (2.0 * np.pi), float(-value.real / abs(value)))
        for value, part in zip(values, size.argmax(axis=0), strict=True)
        if value.imag > -1e-9
    ]
    return sorted(found, key=lambda mode: mode.hz)


class Attitude(NamedTuple):
    """Strokes in mm, pitch in degrees (nose down), tyre loads in N, in steady running."""

    fork_mm: float
    rear_mm: float
    pitch_deg: float
    front_n: float
    rear_n: float


def attitude(motorcycle: Motorcycle, acceleration_ms2: float = 0.0, seconds: float = 6.0) -> Attitude:
    """Where the motorcycle settles on a flat road under a steady longitudinal acceleration, simulated.

    A rear tyre without load means that the motorcycle stands on its front wheel: it cannot brake so hard.
    """
    samples = round(seconds * 1000)
    way = np.zeros((6, samples))
    way[1], way[4], way[5] = 0.0, 1.0, 1.0
    on = np.clip(np.arange(samples) / 1000.0, 0.0, 1.0)
    way[2] = motorcycle.mass_kg * acceleration_ms2 * on
    way[3] = way[2] * motorcycle.height_m
    out = simulate(motorcycle, np.zeros(300), STEP_M, way)
    pitch_deg = float(out[:, COLUMNS.index("pitch_rate_dps")].sum() * 0.001)
    fork, rear, front_n, rear_n = (
        float(out[-1, COLUMNS.index(name)])
        for name in ("fork_stroke_mm", "rear_stroke_mm", "front_tyre_n", "rear_tyre_n")
    )
    rest = equilibrium(motorcycle)[1] * DEGREES_PER_RADIAN
    return Attitude(fork, rear, rest + pitch_deg, front_n, rear_n)


def one_g(motorcycle: Motorcycle) -> Attitude:
    """The attitude under 1 g braking."""
    return attitude(motorcycle, -GRAVITY_M_PER_S2)
