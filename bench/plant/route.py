"""The route: stretches of road in riding order, each with its surface and the speed it is ridden at.

Belongs here: what a route is, its TOML, and how a seed makes another route of it. Never: a road profile.
"""

import math
import operator
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from bench.errors import RouteError
from bench.plant.surface import SURFACES
from bench.toml import read_table

FOLDER = Path(__file__).parent
NAMES = ("mixed_5km", "training")
"""Routes that come with the bench."""


@dataclass(frozen=True)
class Stretch:
    """A piece of road: one surface, one target speed, and speed bumps from `bump_lead_m` on if it has any."""

    surface: str
    length_m: float
    speed_kmh: float
    bumps: int = 0
    bump_spacing_m: float = 30.0
    bump_height_m: float = 0.05
    bump_length_m: float = 0.90
    bump_lead_m: float = 15.0

    def __post_init__(self) -> None:
        if not isinstance(self.surface, str) or self.surface not in SURFACES:
            raise RouteError(f"unknown surface {self.surface!r}; the known ones are {', '.join(SURFACES)}")
        if isinstance(self.bumps, bool) or not isinstance(self.bumps, int):
            raise RouteError(f"bumps is {self.bumps!r}, not a whole number")
        for name, (low, high) in _LIMITS.items():
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
                raise RouteError(f"{name} is {value!r}, not a number from {low:g} to {high:g}")
        need_m = self.bump_lead_m + (self.bumps - 1) * self.bump_spacing_m + self.bump_length_m
        if self.bumps and need_m > self.length_m:
            raise RouteError(f"{self.bumps} bumps need {need_m:g} m, the stretch is {self.length_m:g} m long")


_LIMITS = {
    "length_m": (1.0, 100_000.0),
    "speed_kmh": (10.0, 200.0),  # the speed channel's range is 0-200 km/h (section III.3)
    "bumps": (0, 1000),
    "bump_spacing_m": (2.0, 1000.0),
    "bump_height_m": (0.0, 0.15),
    "bump_length_m": (0.2, 10.0),
    "bump_lead_m": (0.0, 1000.0),
}


@dataclass(frozen=True)
class Route:
    """Stretches in riding order. With `shuffle`, every seed rides its own variation of them."""

    name: str
    stretches: tuple[Stretch, ...]
    shuffle: bool = False

    def __post_init__(self) -> None:
        if not self.stretches:
            raise RouteError(f"route {self.name} has no stretch")

    @property
    def length_m(self) -> float:
        """From start to end."""
        return sum(stretch.length_m for stretch in self.stretches)

    @property
    def nominal_s(self) -> float:
        """Riding time at the target speeds, without the time lost in changing them."""
        return sum(stretch.length_m / (stretch.speed_kmh / 3.6) for stretch in self.stretches)


def load_route(name: str | Path) -> Route:
    """Read a route by its name (see NAMES) or from a TOML file.

    Raises RouteError naming the file, the stretch and the value at fault.
    """
    known = isinstance(name, str) and name in NAMES
    path = FOLDER / f"{name}.toml" if known else Path(name)
    if not known and path.suffix != ".toml":
        raise RouteError(
            f"unknown route {str(name)!r}; the known ones are {', '.join(NAMES)}, or a .toml file"
        )
    table = read_table(path, RouteError)
    for key in table.keys() - {"stretch", "shuffle"}:
        raise RouteError(f"{path}: unknown key {key}")
    shuffle = table.get("shuffle", False)
    if not isinstance(shuffle, bool):
        raise RouteError(f"{path}: shuffle is {shuffle!r}, not true or false")
    rows = table.get("stretch", [])
    if not isinstance(rows, list) or not rows:
        raise RouteError(f"{path}: no [[stretch]]")
    return Route(path.stem, tuple(_stretch(path, k, row) for k, row in enumerate(rows, 1)), shuffle)


def _stretch(path: Path, number: int, row: Any) -> Stretch:
    where = f"{path}: stretch {number}"
    if not isinstance(row, Mapping):
        raise RouteError(f"{where} is {row!r}, not a table")
    names = [field.name for field in fields(Stretch)]
    for key in row:
        if key not in names:
            raise RouteError(f"{where}: unknown key {key}")
    for key in names[:3]:
        if key not in row:
            raise RouteError(f"{where}: missing {key}")
    try:
        return Stretch(**row)
    except RouteError as error:
        raise RouteError(f"{where}: {error}") from None


def checked_seed(seed: int) -> int:
    """Return `seed` as a plain int; RouteError if it is not a whole number from 0."""
    try:
        number = operator.index(seed)
    except TypeError:
        raise RouteError(f"seed is {seed!r}, not a whole number") from None
    if number < 0:
        raise RouteError(f"seed is {number}, below 0")
    return number


def shuffled(route: Route, seed: int) -> Route:
    """The same kinds of road in another order, with other lengths (x0.7-1.3), speeds (x0.85-1.2) and bumps.

    Bump stretches keep their length and are ridden no faster than asked, so that no bump becomes a jump.
    """
    rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence([checked_seed(seed), _SHUFFLE])))
    stretches = []
    for k in rng.permutation(len(route.stretches)):
        stretch = route.stretches[k]
        length, speed, height = rng.uniform((0.7, 0.85, 0.6), (1.3, 1.2, 1.0))
        if stretch.bumps:
            stretch = replace(
                stretch,
                speed_kmh=max(10.0, stretch.speed_kmh * min(speed, 1.0)),
                bump_height_m=stretch.bump_height_m * height,
            )
        else:
            stretch = replace(
                stretch,
                length_m=max(1.0, math.floor(stretch.length_m * length)),
                speed_kmh=min(200.0, max(10.0, stretch.speed_kmh * speed)),
            )
        stretches.append(stretch)
    return Route(route.name, tuple(stretches))


_SHUFFLE = 0x5E  # keeps the shuffle's random stream apart from the ride's
