"""What differs from lap to lap and no channel shows: drawn once, or wandering during the lap, from its seed.

Belongs here: how much varies, and the draws. Never: what the motorcycle makes of it.

FIDELITY: the thesis says nothing of what varied between its laps; the spreads are assumed for one rider and
one machine on one day, which is what its 20 road laps were. Draws are normal, cut at two standard deviations.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.plant.dynamics import GRAVITY_M_PER_S2
from bench.plant.motorcycle import Motorcycle, Tyre
from bench.plant.rider import Rider
from bench.plant.route import Stretch

LOAD_KG = 2.0  # fuel burnt and refilled, what is in the pockets
TYRE = 0.03  # stiffness, as the inflation pressure: 0.07 bar of 2.4
PACE = 0.02
HANDS = 0.1  # of acceleration and braking
OIL_C = 6.0  # temperature of the dampers' oil when the lap begins, about OIL_AT_C
OIL_AT_C = 35.0
OIL_RISE_C = 10.0  # warmer by so much in the end ...
OIL_RISE_S = 400.0  # ... approached so slowly
OIL_PER_C = -0.004  # damping lost per degree: orifices more than viscosity
RIDER_M = 0.03  # the upper body moves fore and aft ...
RIDER_S = 4.0  # ... holding a posture for so long
LEAN_KNOT_M = 70.0  # a bend and the next one
STEEPEST_LEAN = 0.8  # radians, of the cut normal draw: what tyres and courage bear


class Hidden(NamedTuple):
    """One lap's draws."""

    load_kg: float
    tyre: float
    oil_c: float
    rider: Rider


def draw(seeds: np.random.SeedSequence) -> Hidden:
    """Draw what stays the same for a whole lap."""
    z = np.clip(np.random.Generator(np.random.PCG64(seeds)).standard_normal(6), -2.0, 2.0)
    rider = Rider(
        pace=1.0 + PACE * z[2], drive_ms2=2.4 * (1.0 + HANDS * z[3]), brake_ms2=2.8 * (1.0 + HANDS * z[4])
    )
    return Hidden(LOAD_KG * z[0], 1.0 + TYRE * z[1], OIL_AT_C + OIL_C * z[5], rider)


def loaded(motorcycle: Motorcycle, hidden: Hidden) -> Motorcycle:
    """The motorcycle as it stands at the start of this lap."""
    return motorcycle._replace(
        sprung_kg=motorcycle.sprung_kg + hidden.load_kg,
        front_tyre=_inflated(motorcycle.front_tyre, hidden.tyre),
        rear_tyre=_inflated(motorcycle.rear_tyre, hidden.tyre),
    )


def _inflated(tyre: Tyre, factor: float) -> Tyre:
    return tyre._replace(stiffness_n_per_m=tyre.stiffness_n_per_m * factor)


def oil(hidden: Hidden, samples: int) -> NDArray[np.float64]:
    """Factor (samples,) at 1 kHz on the dampers' oil: 1 at OIL_AT_C, less as it warms."""
    rise = OIL_RISE_C * (1.0 - np.exp(-np.arange(samples) / (1000.0 * OIL_RISE_S)))
    factor: NDArray[np.float64] = np.exp(OIL_PER_C * (hidden.oil_c + rise - OIL_AT_C))
    return factor


def posture(motorcycle: Motorcycle, samples: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Moment (samples,) at 1 kHz, N m, nose up, of the rider's upper body moving back and forth."""
    knots = np.clip(rng.standard_normal(int(samples / (1000.0 * RIDER_S)) + 3), -2.0, 2.0)
    back_m = RIDER_M * smooth(knots, np.arange(samples) / (1000.0 * RIDER_S))
    return motorcycle.rider_kg * GRAVITY_M_PER_S2 * back_m


def lean(
    stretches: tuple[Stretch, ...], x_m: NDArray[np.float64], rng: np.random.Generator
) -> NDArray[np.float64]:
    """Lean angle (samples,) in radians at places on the route: a bend every LEAN_KNOT_M, as sharp as drawn.

    FIDELITY: the bends are not in the road: they are what it takes for the speed ridden to need this lean.
    """
    bounds = np.cumsum([stretch.length_m for stretch in stretches])
    knots = np.clip(rng.standard_normal(int(bounds[-1] / LEAN_KNOT_M) + 3), -2.0, 2.0)
    knots[0] = 0.0
    at = (np.arange(len(knots)) + 0.5) * LEAN_KNOT_M
    which = np.minimum(np.searchsorted(bounds, at), len(stretches) - 1)
    typical = np.radians([stretch.lean_deg for stretch in stretches])[which]
    angle: NDArray[np.float64] = np.clip(
        smooth(knots * typical, x_m / LEAN_KNOT_M), -STEEPEST_LEAN, STEEPEST_LEAN
    )
    return angle


def smooth(knots: NDArray[np.float64], place: NDArray[np.float64]) -> NDArray[np.float64]:
    """Read `knots`, one per unit of `place`, with level ends on every step: no corner in what it drives."""
    k = np.clip(place.astype(np.int64), 0, len(knots) - 2)
    f = np.clip(place - k, 0.0, 1.0)
    return knots[k] + (knots[k + 1] - knots[k]) * (f * f * (3.0 - 2.0 * f))
