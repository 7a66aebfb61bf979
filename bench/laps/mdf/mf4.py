"""ASAM MDF4 files: measured channels by name, or the frames of a bus log, both through asammdf.

Belongs here: which channel of a file is which of a lap, its unit, its group's time. Never: blocks and links,
which `bench.laps.mdf.blocks` checks before asammdf sees them; the frames of a bus, which are `mf4_bus`'s.
Times count from the file's start.
"""

import contextlib
import io
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bench.errors import BenchError, LapError
from bench.laps.can import log as can_log
from bench.laps.channel_map import UNITS, ChannelMap, Row
from bench.laps.columns import TIME, columns_from_lap
from bench.laps.lap import Lap
from bench.laps.mdf import bus as mf4_bus
from bench.laps.mdf.blocks import Blocks
from bench.laps.recording import Recording, Track
from bench.mf4 import START, forget_save_time
from bench.quiet import quiet
from dbc import CHANNELS

if TYPE_CHECKING:
    from asammdf import MDF

Place = tuple[int, int]
"""(group, channel) of a file."""

_UNIT = {"mm": "mm", "dps": "deg/s", "kmh": "km/h", "ms2": "m/s2"}
_PLAIN = {0, 1, 2, 4, 5, 6}
"""Conversions that yield numbers: none, linear, rational, tables. A file's formula is not evaluated."""
_FARTHEST_S = 9.2e9  # int64 nanoseconds
_TIME_MASTER = 1


def read(path: Path, channel_map: ChannelMap | None = None) -> Recording:
    """Read the channels named as a lap's, or those that the map names; a bus log through the map's DBC.

    Without a map a channel's unit must be its name's, where the file gives one. Samples that the file marks
    invalid are left out and counted. A map's [time] is for tables, and passed over.
    Raises LapError without asammdf, for a file that is damaged or cut short, and naming the channel that is
    missing, ambiguous or no numbers.
    """
    _need_asammdf()
    data = can_log.content(path)
    try:
        damage = Blocks(data, str(path)).damage
        with _opened(data) as mdf:
            return _read(mdf, path, channel_map, damage)
    except BenchError:
        raise
    except Exception as error:  # whatever asammdf stumbled over
        reason = " ".join(str(error).split()) or type(error).__name__
        raise LapError(f"{path}: damaged, or not what asammdf reads: {reason}") from None


def write(lap: Lap, path: Path) -> None:
    """Write a lap: one group of float64 channels with units, time in seconds; same lap, same bytes."""
    _need_asammdf()
    from asammdf import MDF, Signal

    columns = columns_from_lap(lap)
    t_s = columns.pop(TIME)
    signals = [
        Signal(samples=values, timestamps=t_s, name=name, unit=_UNIT[name.rsplit("_", 1)[1]])
        for name, values in columns.items()
    ]
    with MDF(version="4.10") as mdf, path.open("w+b") as file:
        mdf.header.start_time = START
        mdf.append(signals, common_timebase=True)
        mdf.save(file, compression=2)
    forget_save_time(path)


def _need_asammdf() -> None:
    if find_spec("asammdf") is None:
        raise LapError(".mf4 needs asammdf: pip install 'strokebench[mdf]'")


@contextlib.contextmanager
def _opened(data: bytes) -> "Iterator[MDF]":
    """The file, in memory: of a path asammdf would read with threads of its own, in C, unchecked."""
    from asammdf import MDF

    options = {"process_bus_logging": False, "use_display_names": False}
    with (
        contextlib.redirect_stdout(io.StringIO()),  # it prints tracebacks
        quiet("asammdf"),
        np.errstate(all="ignore"),
        MDF(io.BytesIO(data), **options) as mdf,
    ):
        yield mdf


def _read(mdf: "MDF", path: Path, channel_map: ChannelMap | None, damage: list[str]) -> Recording:
    places = _places(mdf)
    if channel_map is None:
        rows = {name: Row(name, name) for name in CHANNELS if name in places}
    else:
        rows = dict(channel_map.rows)
    missing = [row for row in rows.values() if row.signal not in places]
    if not rows or missing:
        frames = mf4_bus.frames(mdf, str(path), tuple(damage))
        if frames is not None:
            return can_log.recording(path, frames, channel_map)
        what = f"no channel {missing[0].signal}" if missing else f"no channel of {', '.join(CHANNELS)}"
        raise LapError(f"{path}: {what}; it has {_some(sorted(places))}")
    others = sorted(set(places) - {row.signal for row in rows.values()})
    if channel_map is None and others:
        damage.append(f"channels passed over, for no lap has them: {_some(others)}")
    times: dict[int, NDArray[np.int64]] = {}
    tracks = {}
    for name, row in rows.items():
        found = places[row.signal]
        if len(found) > 1:
            groups = ", ".join(str(group) for group, _ in found)
            raise LapError(f"{path}: channel {row.signal} is there {len(found)} times, in groups {groups}")
        track = _track(mdf, found[0], row, str(path), channel_map is None, damage)
        shared = times.setdefault(found[0][0], track.t_ns)
        if np.array_equal(shared, track.t_ns):
            track = Track(shared, track.values)
        tracks[name] = track
    common = len({id(track.t_ns) for track in tracks.values()}) == 1
    rate_hz = None if channel_map is None else channel_map.rate_hz
    ordered = {name: tracks[name] for name in CHANNELS if name in tracks}
    return Recording(str(path), path.name, ordered, common, rate_hz, tuple(damage))


def _places(mdf: "MDF") -> dict[str, list[Place]]:
    """Where each channel that has samples and is no time is, by name."""
    places: dict[str, list[Place]] = {}
    for at, group in enumerate(mdf.groups):
        for number, channel in enumerate(group.channels):
            if group.channel_group.cycles_nr and number != mdf.masters_db.get(at):
                places.setdefault(channel.name, []).append((at, number))
    return places


def _some(names: list[str]) -> str:
    """The first of `names`, for a message."""
    return ", ".join(names[:12]) + (f" and {len(names) - 12} more" if len(names) > 12 else "") or "none"


def _track(mdf: "MDF", place: Place, row: Row, where: str, by_name: bool, damage: list[str]) -> Track:
    """One channel's samples with their times, in the lap's unit."""
    at, number = place
    group = mdf.groups[at]
    master = mdf.masters_db.get(at)
    if master is None or group.channels[master].sync_type != _TIME_MASTER:
        raise LapError(f"{where}: channel {row.signal}: its group {at} has no time")
    for channel in (group.channels[number], group.channels[master]):
        kind = channel.conversion.conversion_type if channel.conversion else 0
        if kind not in _PLAIN:
            raise LapError(
                f"{where}: channel {channel.name}: a conversion (type {kind}) to text or by formula"
            )
    signal = mdf.get(group=at, index=number)
    values, t_s = signal.samples, signal.timestamps
    if values.dtype.kind not in "fiub" or values.ndim != 1:
        raise LapError(f"{where}: channel {row.signal} holds {values.dtype}, not numbers")
    if len(values) == 0 or len(values) != len(t_s):
        raise LapError(f"{where}: channel {row.signal}: {len(values)} samples at {len(t_s)} instants")
    cycles = group.channel_group.cycles_nr
    if len(values) != cycles:
        damage.append(f"channel {row.signal}: {cycles - len(values)} of {cycles} samples not valid, left out")
    values = values.astype(np.float64)
    t_s = Row(TIME, "time").convert(t_s, group.channels[master].unit or "s", where)
    for kind, column in (("time", t_s), ("value", values)):
        bad = np.flatnonzero(~(np.abs(column) < (_FARTHEST_S if kind == "time" else np.inf)))
        if bad.size:
            k = int(bad[0])
            raise LapError(
                f"{where}: channel {row.signal}, sample {k + 1}: {kind} {column[k]} is no number to use"
            )
    return Track(np.rint(t_s * 1e9).astype(np.int64), _converted(values, signal.unit, row, where, by_name))


def _converted(
    values: NDArray[np.float64], unit: str, row: Row, where: str, by_name: bool
) -> NDArray[np.float64]:
    if not by_name:
        return row.convert(values, unit, where)
    ending = row.channel.rsplit("_", 1)[1]
    if (unit or "").strip() and UNITS[ending].get(unit.strip()) != 1.0:
        raise LapError(
            f"{where}: channel {row.signal} is in {unit.strip()!r}; a channel map says what to make of it"
        )
    return values
