"""The route: stretches of road in riding order, each with its road and the speed it is ridden at.

Belongs here: what a route is, its TOML, and how a seed makes another route of it. Never: a road profile.
"""

import math
import operator
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from bench.errors import RouteError
from bench.plant.road.obstacles import Obstacle
from bench.plant.road.profiles import load_profile
from bench.plant.road.stretch import Stretch
from bench.toml import read_table

__all__ = ["FOLDER", "NAMES", "Obstacle", "Route", "Stretch", "checked_seed", "load_route", "shuffled"]

FOLDER = Path(__file__).parent / "routes"
NAMES = (
    "mixed_5km",
    "training",
    "test_lap",
    "random",
    "motorway",
    "pave",
    "english_track",
    "short_back",
    "drain_well",
)
"""Routes that come with the bench; the last six are the benchmark roads of the paper on virtual sensors."""


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


_STRETCH_KEYS = ("surface", "profile", "profile_v_m", "length_m", "speed_kmh", "lean_deg", "obstacle")
_OBSTACLE_KEYS = tuple(field.name for field in fields(Obstacle))


def _stretch(path: Path, number: int, row: Any) -> Stretch:
    where = f"{path}: stretch {number}"
    table = _table(where, row, _STRETCH_KEYS, ("length_m", "speed_kmh"))
    obstacles = table.pop("obstacle", [])
    if not isinstance(obstacles, list):
        raise RouteError(f"{where}: obstacle is {obstacles!r}, not [[stretch.obstacle]]")
    name, v_m = table.pop("profile", None), table.pop("profile_v_m", None)
    if name is None and "surface" not in table:
        raise RouteError(f"{where}: missing surface or profile")
    if name is None and v_m is not None:
        raise RouteError(f"{where}: profile_v_m is {v_m!r}, but there is no profile")
    if name is not None and not isinstance(name, str):
        raise RouteError(f"{where}: profile is {name!r}, not the name of a file")
    laid = tuple(_obstacle(f"{where}: obstacle {k}", obstacle) for k, obstacle in enumerate(obstacles, 1))
    try:
        profile = None if name is None else load_profile(path.parent / name, 0.0 if v_m is None else v_m)
        return Stretch(table.pop("surface", None), **table, obstacles=laid, profile=profile)
    except RouteError as error:
        raise RouteError(f"{where}: {error}") from None


def _obstacle(where: str, row: Any) -> Obstacle:
    required = tuple(field.name for field in fields(Obstacle) if field.default is MISSING)
    table = _table(where, row, _OBSTACLE_KEYS, required)
    try:
        return Obstacle(**table)
    except RouteError as error:
        raise RouteError(f"{where}: {error}") from None


def _table(where: str, row: Any, keys: tuple[str, ...], required: tuple[str, ...]) -> dict[str, Any]:
    """A copy of a table that has no key but `keys`, and all that are `required`."""
    if not isinstance(row, Mapping):
        raise RouteError(f"{where} is {row!r}, not a table")
    for key in row:
        if key not in keys:
            raise RouteError(f"{where}: unknown key {key}; the known ones are {', '.join(keys)}")
    for key in required:
        if key not in row:
            raise RouteError(f"{where}: missing {key}")
    return dict(row)


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
    """The same kinds of road in another order, of other lengths (x0.7-1.3), at other speeds (x0.85-1.2).

    Stretches with obstacles keep their length and are ridden no faster than asked, and the obstacles are
    lower (x0.6-1), so that no bump becomes a jump.
    """
    rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence([checked_seed(seed), _SHUFFLE])))
    stretches = []
    for k in rng.permutation(len(route.stretches)):
        stretch = route.stretches[k]
        length, speed, height = rng.uniform((0.7, 0.85, 0.6), (1.3, 1.2, 1.0))
        if stretch.obstacles:
            stretch = replace(
                stretch,
                speed_kmh=max(10.0, stretch.speed_kmh * min(speed, 1.0)),
                obstacles=tuple(replace(o, height_m=o.height_m * height) for o in stretch.obstacles),
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
