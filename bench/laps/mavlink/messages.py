"""What logs of typed messages share, MAVLink's and DataFlash's: naming a signal, skipping what is no message.

Belongs here: TYPE[instance].field[index], and from found signals to a recording. Never: a byte of a format.
"""

import re
from collections.abc import Hashable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.errors import LapError
from bench.laps.channel_map import Row
from bench.laps.lap import Lap
from bench.laps.recording import Recording, Track
from bench.laps.steps import EPOCH_NS

LATEST_US = 4_000_000_000_000_000
"""126 years: a microsecond clock that shows more is damaged; nanoseconds of it fit int64."""

_MOST_BYTES = 2 << 30
"""Longest file read; a sparse or endless one is not swallowed whole."""

_NAMED = 5
"""So many damaged stretches are named, the others counted."""

_SIGNAL = re.compile(r"(\w+)(?:\[([^\[\]]+)\])?\.(\w+)(?:\[(\d{1,3})\])?", re.ASCII)


@dataclass(frozen=True)
class Address:
    """Where a signal is: TYPE[instance].field[index], instance and index None where left out."""

    kind: str
    instance: str | None
    field: str
    index: int | None


@dataclass(frozen=True)
class Signal:
    """One signal's samples: t_us (samples,) integers, values (samples,) float64, as the log has them.

    stream: equal for signals of the same messages, which are sampled together.
    """

    row: Row
    stream: Hashable
    t_us: NDArray[np.integer]
    values: NDArray[np.float64]
    unit: str | None = None


def address(row: Row, where: str) -> Address:
    """The address a map's row names; LapError if its signal is written otherwise."""
    match = _SIGNAL.fullmatch(row.signal)
    if match is None:
        raise LapError(
            f"{where}: signal {row.signal!r} is not TYPE.field, TYPE[instance].field or ...field[index]"
        )
    kind, instance, field, index = match.groups()
    return Address(kind, instance, field, None if index is None else int(index))


def content(path: Path) -> NDArray[np.uint8]:
    """A log's bytes; LapError beyond 2 GiB."""
    size = path.stat().st_size
    if size > _MOST_BYTES:
        raise LapError(f"{path}: {size} bytes; a log is read up to {_MOST_BYTES}: cut it to the lap")
    return np.fromfile(path, dtype=np.uint8)


def between(starts: NDArray[np.int64], ends: NDArray[np.int64], size: int) -> tuple[str, ...]:
    """Lines about the bytes that belong to no message, given where messages start and end, in order."""
    first = np.concatenate(([0], ends))
    last = np.concatenate((starts, [size]))
    holes = np.flatnonzero(last > first)
    lines = [
        f"bytes {first[k]} to {last[k] - 1}: {last[k] - first[k]} bytes are no whole message"
        + (", up to the end of the file" if last[k] == size else "")
        for k in holes[:_NAMED]
    ]
    if len(holes) > _NAMED:
        rest = holes[_NAMED:]
        lines.append(
            f"and {len(rest)} more such stretches, {(last - first)[rest].sum()} bytes, the last at byte "
            f"{first[rest[-1]]}"
        )
    return tuple(lines)


def listed(names: Iterable[str]) -> str:
    """Names as text, the first dozen of them."""
    every = list(names)
    return ", ".join(every[:12]) + (f" and {len(every) - 12} more" if len(every) > 12 else "")


def element(values: NDArray, index: int | None, row: Row, where: str) -> NDArray[np.float64]:
    """A field's numbers (messages,), of a field (messages, elements) those of one element, as float64.

    Raises LapError for text, and for an index where there are no elements, or none where there are.
    """
    if values.dtype.kind == "S":
        raise LapError(f"{where}: signal {row.signal} is text")
    if values.ndim == 1:
        if index is not None:
            raise LapError(f"{where}: signal {row.signal} is a single number, without elements")
        return values.astype(np.float64)
    if index is None or index >= values.shape[1]:
        raise LapError(f"{where}: signal {row.signal} has elements [0] to [{values.shape[1] - 1}]")
    return values[:, index].astype(np.float64)


def one(found: NDArray, wanted: int | str | None, what: str) -> NDArray[np.bool_]:
    """Which of `found` (messages,) are the one wanted; None is any, if there is only one.

    Raises LapError listing them if the wanted one is not there or it is not said which is wanted.
    """
    values = np.unique(found)
    if wanted is None and len(values) == 1:
        return np.ones(len(found), dtype=bool)
    if wanted is None or wanted not in values:
        which = "say which" if wanted is None else f"{wanted} is not there"
        raise LapError(f"{what} is {listed(map(str, values.tolist()))}: {which}")
    return found == wanted


def whole_us(lap: Lap) -> NDArray[np.int64]:
    """A lap's times in whole microseconds; LapError if two samples would share one, or beyond 50 days."""
    t_us = (lap.t_ns + 500) // 1000
    shared = np.flatnonzero(np.diff(t_us) == 0)
    if shared.size:
        k = int(shared[0])
        raise LapError(
            f"samples {k} and {k + 1} at {lap.t_ns[k]} and {lap.t_ns[k + 1]} ns share a microsecond"
        )
    if lap.t_ns[-1] >= EPOCH_NS:
        raise LapError(
            f"time {lap.t_ns[-1]} ns does not fit: beyond 50 days it would be read as a date; shift the lap "
            "towards 0"
        )
    return t_us


def recording(
    path: Path, signals: Mapping[str, Signal], rate_hz: float | None, damage: Iterable[str]
) -> Recording:
    """Signals, by channel, as a recording; those of the same messages keep their common time base.

    Samples that are no number, or at a time no clock shows, are dropped and reported.
    Raises LapError if a unit is not known or nothing is left.
    """
    lines = list(damage)
    common = rate_hz is None and len({signal.stream for signal in signals.values()}) == 1
    good = {name: _usable(signal, lines) for name, signal in signals.items()}
    if common:
        together: NDArray[np.bool_] = np.logical_and.reduce(list(good.values()))
        good = {name: together for name in good}
    tracks = {}
    for name, signal in signals.items():
        keep = good[name]
        if not keep.any():
            raise LapError(f"{path}: signal {signal.row.signal} has no sample that is a number")
        t_ns = signal.t_us[keep].astype(np.int64) * 1000
        values = signal.values[keep]
        # a channel in the unit of its own name comes back bit for bit
        if signal.unit != name:
            values = signal.row.convert(values, signal.unit, str(path))
        tracks[name] = Track(t_ns, values)
    return Recording(str(path), path.name, tracks, common, rate_hz, tuple(lines))


def _usable(signal: Signal, lines: list[str]) -> NDArray[np.bool_]:
    finite, early = np.isfinite(signal.values), signal.t_us <= LATEST_US
    for mask, what in ((finite, "no number"), (early, "at a time no clock shows")):
        if not mask.all():
            line = (
                f"{signal.row.signal}: {np.count_nonzero(~mask)} of {len(mask)} samples are {what}, dropped, "
                f"the first is sample {int(np.argmin(mask))}"
            )
            if line not in lines:
                lines.append(line)
    return finite & early
