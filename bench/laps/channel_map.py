"""The channel map: which signal of a file is which channel, in which unit, scaled and shifted how. TOML.

    dbc = "bike.dbc"             # CAN logs: layout, beside the map; left out: motorcycle.dbc
    rate_hz = 1000               # the lap's time base; left out: the fastest mapped signal's

    [time]                       # tables whose time column is not t_s
    signal = "Time"
    unit = "ms"

    [channels.fork_stroke_mm]
    signal = "SUSPENSION.Fork"   # MESSAGE.SIGNAL of a DBC, TYPE.FIELD (MAVLink), a column, a channel (.mf4)
    unit = "cm"                  # left out: what the file says, where it says one
    scale = 1.0                  # channel = signal, in the channel's unit, times scale plus offset
    offset = 0.0
    bus = 1                      # CAN logs of several buses: the one meant; left out: any

    [sst]                        # .sst: the sensors' geometry, see bench.laps.sufni

Belongs here: the map and the units it knows. Never: a file format.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.errors import LapError
from bench.toml import read_table
from dbc import CHANNELS

UNITS: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        "mm": {"mm": 1.0, "cm": 10.0, "m": 1e3, "um": 1e-3, "in": 25.4},
        "dps": {
            "dps": 1.0,
            "deg/s": 1.0,
            "°/s": 1.0,
            "mdps": 1e-3,
            "rad/s": 180.0 / math.pi,
            "mrad/s": 0.18 / math.pi,
        },
        "kmh": {"km/h": 1.0, "kmh": 1.0, "kph": 1.0, "m/s": 3.6, "cm/s": 0.036, "mph": 1.609344, "kn": 1.852},
        "ms2": {
            "m/s2": 1.0,
            "m/s^2": 1.0,
            "m/s²": 1.0,
            "m/s/s": 1.0,
            "mm/s2": 1e-3,
            "g": 9.80665,
            "mg": 9.80665e-3,
        },
        "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0},
    }
)
"""Ending of a channel's name -> the units that can become it -> what to multiply by."""


@dataclass(frozen=True)
class Row:
    """One mapped signal; `unit` None where the file is to say it, `bus` None for any."""

    channel: str
    signal: str
    unit: str | None = None
    scale: float = 1.0
    offset: float = 0.0
    bus: int | None = None

    def convert(self, values: NDArray[np.float64], file_unit: str | None, where: str) -> NDArray[np.float64]:
        """`values` (samples,) of the file in the channel's unit, scaled and shifted.

        file_unit: what the file itself says, used if the map says nothing. Raises LapError naming the unit
        if neither says one that is known.
        """
        unit = self.unit or (file_unit or "").strip()
        known = UNITS[self.channel.rsplit("_", 1)[1]]
        if unit not in known:
            said = f"unit {unit!r}" if unit else "no unit in the file or the map"
            raise LapError(
                f"{where}: signal {self.signal}: {said}; {self.channel} can come from {', '.join(known)}"
            )
        return values * (known[unit] * self.scale) + self.offset


@dataclass(frozen=True)
class ChannelMap:
    """A checked map; `rows` by channel name. `sst`: a table as it stands, checked by the format's reader."""

    where: str
    rows: Mapping[str, Row]
    dbc: Path | None = None
    rate_hz: float | None = None
    time: Row | None = None
    sst: Mapping[str, Any] | None = None


def load_map(path: Path) -> ChannelMap:
    """Read and check a map. Raises LapError naming the file, the key and the value at fault."""
    path = Path(path)
    table = read_table(path, LapError)
    _only(table, ("dbc", "rate_hz", "time", "channels", "sst"), str(path))
    rate_hz = table.get("rate_hz")
    if rate_hz is not None:
        rate_hz = _number(rate_hz, f"{path}: rate_hz")
        if not 1.0 <= rate_hz <= 100_000.0:
            raise LapError(f"{path}: rate_hz is {rate_hz:g}, not from 1 to 100000")
    dbc = table.get("dbc")
    if dbc is not None and not isinstance(dbc, str):
        raise LapError(f"{path}: dbc is {dbc!r}, not a file's name")
    time = _row(table["time"], "t_s", f"{path}: [time]") if "time" in table else None
    sst = table.get("sst")
    if sst is not None and not isinstance(sst, dict):
        raise LapError(f"{path}: sst is {sst!r}, not a table")
    channels = table.get("channels", {})
    if not isinstance(channels, dict) or not channels:
        raise LapError(f"{path}: no [channels.NAME]; the known ones are {', '.join(CHANNELS)}")
    for name in channels:
        if name not in CHANNELS:
            raise LapError(f"{path}: unknown channel {name}; the known ones are {', '.join(CHANNELS)}")
    rows = {name: _row(row, name, f"{path}: channels.{name}") for name, row in channels.items()}
    return ChannelMap(str(path), rows, None if dbc is None else path.parent / dbc, rate_hz, time, sst)


def _row(table: Any, channel: str, where: str) -> Row:
    if not isinstance(table, dict):
        raise LapError(f"{where} is {table!r}, not a table")
    _only(table, ("signal", "unit", "scale", "offset", "bus"), where)
    signal, unit, bus = table.get("signal"), table.get("unit"), table.get("bus")
    if not isinstance(signal, str) or not signal:
        raise LapError(f"{where}: signal is {signal!r}, not a signal's name")
    if unit is not None:
        known = UNITS[channel.rsplit("_", 1)[1]]
        if unit not in known:
            raise LapError(f"{where}: unknown unit {unit!r}; {channel} can come from {', '.join(known)}")
    if bus is not None and (isinstance(bus, bool) or not isinstance(bus, int)):
        raise LapError(f"{where}: bus is {bus!r}, not a whole number")
    scale = _number(table.get("scale", 1.0), f"{where}: scale")
    if scale == 0.0:
        raise LapError(f"{where}: scale is 0")
    return Row(channel, signal, unit, scale, _number(table.get("offset", 0.0), f"{where}: offset"), bus)


def _number(value: Any, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise LapError(f"{where} is {value!r}, not a finite number")
    return float(value)


def _only(table: dict[str, Any], known: tuple[str, ...], where: str) -> None:
    for key in table:
        if key not in known:
            raise LapError(f"{where}: unknown key {key}; the known ones are {', '.join(known)}")
