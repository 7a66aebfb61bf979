"""Obstacles as data: bumps, holes, rails and steps, alone or in sequences, laid on whatever road there is.

Belongs here: the shapes, one row of KINDS each, their limits, where a sequence puts them. Never: roughness.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.errors import RouteError
from bench.plant.road.grid import STEP_M
from bench.plant.road.limits import check_number, check_whole

Array = NDArray[np.float64]
_GAUGE_M = 1.435  # standard gauge, between the rails' inner faces
_RAIL_M = 0.07  # width of a rail's head
_FLANGEWAY_M = 0.065  # groove for the wheels' flanges
_SEAM_M = 1.8  # the least length that holds two rails, their grooves and their edges


def _bump(x: Array, length: float) -> Array:
    """Rounded hump, (1 - u^2)^2 with u from -1 to 1."""
    u = 2.0 * x / length - 1.0
    return (1.0 - u * u) ** 2


def _ramps(x: Array, length: float, ramp_m: float) -> Array:
    """Flat top between two ramps of half a cosine each."""
    edge = np.clip(np.minimum(x, length - x) / ramp_m, 0.0, 1.0)
    return 0.5 - 0.5 * np.cos(np.pi * edge)


def _plateau(x: Array, length: float) -> Array:
    """Speed table: ramps of 27 % of the length, those of the 22-foot table (6 + 10 + 6 feet)."""
    return _ramps(x, length, 0.27 * length)


def _pothole(x: Array, length: float) -> Array:
    """Bowl that deepens over half a cosine up to a broken edge of 6 cm."""
    edge = min(0.06, 0.2 * length)
    bowl = 0.5 - 0.5 * np.cos(np.pi * np.clip(x / (length - edge), 0.0, 1.0))
    return -bowl * np.clip((length - x) / edge, 0.0, 1.0)


def _drain_well(x: Array, length: float) -> Array:
    """Sunken cover: a flat floor between steep edges of 4 cm."""
    return -_ramps(x, length, min(0.04, 0.25 * length))


def _rail_crossing(x: Array, length: float) -> Array:
    """Two rails proud of the road, a groove inside each.

    FIDELITY: the grooves are as deep as the rails are proud; real ones are deeper, but a tyre bridges them.
    """
    centre = 0.5 * length
    inside = np.abs(x - centre) - 0.5 * _GAUGE_M  # distance outward from a rail's inner face
    rail = (inside >= 0.0) & (inside <= _RAIL_M)
    groove = (inside < 0.0) & (inside >= -_FLANGEWAY_M)
    return rail.astype(float) - groove


def _step(x: Array, length: float) -> Array:
    """Change of level, half a cosine; the road goes on at the new height."""
    return 0.5 - 0.5 * np.cos(np.pi * x / length)


class Kind(NamedTuple):
    """A shape over places x in metres from its start, 0 to its length, for unit height; and its limits."""

    shape: Callable[[Array, float], Array]
    height_m: tuple[float, float]
    length_m: tuple[float, float]


KINDS = {
    "bump": Kind(_bump, (0.0, 0.15), (0.2, 10.0)),
    "dip": Kind(lambda x, length: -_bump(x, length), (0.0, 0.15), (0.2, 10.0)),
    "plateau": Kind(_plateau, (0.0, 0.15), (1.0, 30.0)),
    "pothole": Kind(_pothole, (0.0, 0.15), (0.2, 3.0)),
    "drain_well": Kind(_drain_well, (0.0, 0.15), (0.2, 2.0)),
    "rail_crossing": Kind(_rail_crossing, (0.0, 0.05), (_SEAM_M, 10.0)),
    "step": Kind(_step, (-0.10, 0.10), (0.04, 10.0)),  # below zero it goes down
}
"""What can lie on a road. The height of a dip, a pothole and a drain well is its depth."""


@dataclass(frozen=True)
class Obstacle:
    """`count` obstacles of one kind from `first_m` of their stretch on, `spacing_m` from start to start.

    `spacing_jitter` makes the sequence irregular: each spacing is drawn between 1 - jitter and 1 + jitter
    times what is asked. Raises RouteError naming a value outside its limits.
    """

    kind: str
    first_m: float
    height_m: float
    length_m: float
    count: int = 1
    spacing_m: float = 30.0
    spacing_jitter: float = 0.0

    def __post_init__(self) -> None:
        if not isinstance(self.kind, str) or self.kind not in KINDS:
            raise RouteError(f"unknown kind {self.kind!r}; the known ones are {', '.join(KINDS)}")
        kind = KINDS[self.kind]
        check_whole("count", self.count, 1, 10_000)
        check_number("first_m", self.first_m, 0.0, 100_000.0)
        check_number("spacing_m", self.spacing_m, 0.2, 10_000.0)
        check_number("spacing_jitter", self.spacing_jitter, 0.0, 0.9)
        check_number("height_m", self.height_m, *kind.height_m)
        check_number("length_m", self.length_m, *kind.length_m)
        closest_m = self.spacing_m * (1.0 - self.spacing_jitter)
        if self.count > 1 and closest_m < self.length_m:
            raise RouteError(
                f"{self.kind}s of length_m {self.length_m:g} overlap at spacing_m {self.spacing_m:g} with "
                f"spacing_jitter {self.spacing_jitter:g}"
            )

    @property
    def need_m(self) -> float:
        """Length of stretch that holds the whole sequence, whatever is drawn."""
        widest_m = self.spacing_m * (1.0 + self.spacing_jitter)
        return self.first_m + (self.count - 1) * widest_m + self.length_m

    def places_m(self, rng: np.random.Generator) -> Array:
        """Where each begins, (count,), in metres from the start of the stretch."""
        spread = 1.0 + self.spacing_jitter * rng.uniform(-1.0, 1.0, self.count - 1)
        return self.first_m + np.concatenate([[0.0], np.cumsum(self.spacing_m * spread)])


def put(obstacle: Obstacle, height_m: Array, rng: np.random.Generator) -> float:
    """Add a sequence to the heights (samples,) of its stretch; return by how much the level rose."""
    shape = KINDS[obstacle.kind].shape
    cells = max(1, math.ceil(obstacle.length_m / STEP_M - 1e-9))
    lift = obstacle.height_m * shape(np.linspace(0.0, obstacle.length_m, cells + 1), obstacle.length_m)
    rises = np.zeros(len(height_m))
    for place in obstacle.places_m(rng):
        first = round(float(place) / STEP_M)
        room = height_m[first : first + cells + 1]
        room += lift[: len(room)]
        rises[first + cells + 1 : first + cells + 2] = lift[-1]
    height_m += np.cumsum(rises)  # what ends higher than it began has lifted the road
    return float(lift[-1]) * obstacle.count
