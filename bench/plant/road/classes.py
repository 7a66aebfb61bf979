"""The proof of the synthesis: surfaces drawn, measured again, and held to their class.

Belongs here: the round trip. Never: a formula of its own.
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from bench.errors import RouteError
from bench.plant.road.grid import STEP_M
from bench.plant.road.iso8608 import HIGHEST_PER_M, LEVELS_M3, LOWEST_PER_M, class_of, density, limits
from bench.plant.road.limits import check_number
from bench.plant.road.spectrum import fitted, measured
from bench.plant.road.surface import SURFACES, lay

CLASSES = tuple(f"iso_{letter.lower()}" for letter in LEVELS_M3)


class ClassRow(NamedTuple):
    """One surface, drawn and measured."""

    surface: str
    iso: str  # class of its level as given
    level_m3: float  # Gd(0.1) of the line through the measured spectrum
    lower_m3: float  # half of the level as given ...
    upper_m3: float  # ... and double: for the ISO classes these are their limits
    slope: float  # of the line through the measured spectrum: minus the waviness
    inside: float  # share of the bands from 0.011 to 2.83 cycles/m within the limits


def class_table(surfaces: Iterable[str] = CLASSES, length_m: float = 5000.0, seed: int = 0) -> list[ClassRow]:
    """Draw `length_m` of each surface, measure it, and say how well it keeps to what it was drawn from.

    A surface that is no ISO class is held to a factor of two about its own level, as a class is. Stones come
    on top of the level: cobblestone and pave lie above their limits about the stones' length.
    Raises RouteError for an unknown surface and for a length outside 200-100,000 m.
    """
    check_number("length_m", length_m, 200.0, 100_000.0)
    rows = []
    for name in surfaces:
        if name not in SURFACES:
            raise RouteError(f"unknown surface {name!r}; the known ones are {', '.join(SURFACES)}")
        surface = SURFACES[name]
        # a stream for each name, so that no two rows are one road to another scale
        stream = np.random.SeedSequence(seed, spawn_key=(list(SURFACES).index(name),))
        height = lay(surface, round(length_m / STEP_M), 1.0, stream)
        spectrum = measured(height, STEP_M)
        line = fitted(spectrum)
        n, g = spectrum
        lower, upper = limits(surface.roughness_m3)
        ratio = g / density(n, surface.roughness_m3, surface.waviness)
        told = (n >= LOWEST_PER_M) & (n <= HIGHEST_PER_M)
        inside = np.mean((ratio[told] >= 0.5) & (ratio[told] <= 2.0))
        iso = class_of(surface.roughness_m3)
        rows.append(ClassRow(name, iso, line.level_m3, lower, upper, -line.waviness, float(inside)))
    return rows
