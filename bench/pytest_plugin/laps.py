"""The lap a test rides: simulated or read as its marker says, once in a session."""

from pathlib import Path
from typing import Any

import pytest

from bench.errors import LapError
from bench.laps.lap import Lap
from bench.pytest_plugin.refusals import arguments

SIMULATED: dict[str, object] = {"route": "test_lap", "motorcycle": "gsxr1000", "seed": 1, "seconds": 20.0}
READ: dict[str, object] = {"file": None, "map": None, "repair": False}
INSTRUMENTS: dict[str, object] = {"sensors": "datasheet", "sensor_seed": 0, "rate": None}

_LAPS: pytest.StashKey[dict[tuple[object, ...], Lap]] = pytest.StashKey()


def settings_of(item: pytest.Item) -> dict[str, Any]:
    """What the marker `lap` of `item` says, over the defaults."""
    return arguments(item, "lap", SIMULATED | READ | INSTRUMENTS, "route")


def lap_of(item: pytest.Item) -> Lap:
    """The lap of `item`'s marker; a file's name is relative to the test's own.

    Raises LapError or RouteError for one that cannot be had.
    """
    settings = settings_of(item)
    cache = item.config.stash.setdefault(_LAPS, {})
    if settings["file"] is None:
        key = tuple(settings[name] for name in SIMULATED)
        make = _simulated
    else:
        given = item.get_closest_marker("lap")
        both = [name for name in SIMULATED if given and name in given.kwargs]
        if both:
            raise LapError(f"marker lap: file is {settings['file']}, and {', '.join(both)} of a simulation")
        settings["file"] = beside(item, settings["file"])
        settings["map"] = settings["map"] and beside(item, settings["map"])
        key = tuple(settings[name] for name in READ)
        make = _read
    if key not in cache:
        cache[key] = make(settings)
    return cache[key]


def beside(item: pytest.Item, name: str | Path) -> Path:
    """A file that a marker names, relative to the test's own."""
    return item.path.parent / name


def _simulated(settings: dict[str, Any]) -> Lap:
    from bench.plant.motorcycle import load_motorcycle
    from bench.plant.ride import ride
    from bench.plant.route import load_route

    route, motorcycle = load_route(settings["route"]), load_motorcycle(settings["motorcycle"])
    return ride(route, motorcycle, settings["seed"], settings["seconds"])


def _read(settings: dict[str, Any]) -> Lap:
    from bench.laps.channel_map import load_map
    from bench.laps.files import read_lap

    mapping = load_map(settings["map"]) if settings["map"] else None
    return read_lap(settings["file"], mapping, settings["repair"])
