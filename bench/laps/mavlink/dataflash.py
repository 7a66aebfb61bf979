"""ArduPilot's DataFlash logs (.bin), read through a channel map, and laps written as one.

    [channels.pitch_rate_dps]
    signal = "IMU[0].GyrY"     # TYPE.field, in brackets the instance where a type has several; the unit
                               # is the log's own, multiplied as it says; one given here takes the bare number

The clock is `TimeUS`, since the start-up, the same for all messages; in logs of before 2015 `TimeMS`, or `T`
in messages that have the GPS week, whose `TimeMS` is the satellites'.

Without a map a lap is read from the messages LAP that `write` makes, in the units of the channels' names.

Belongs here: types, instances, units, channels. Never: a record's framing, which is `records`'.
"""

import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.errors import LapError
from bench.laps.channel_map import ChannelMap, Row
from bench.laps.lap import Lap
from bench.laps.mavlink.messages import LATEST_US, Signal, address, element, listed, one, recording, whole_us
from bench.laps.mavlink.records import FMT, Definition, Log, definition_record, head
from bench.laps.recording import Recording

_LABELS = {
    "fork_stroke_mm": "Fork",
    "rear_stroke_mm": "Rear",
    "pitch_rate_dps": "Pitch",
    "speed_kmh": "Speed",
    "acc_front_ms2": "AccF",
    "acc_rear_ms2": "AccR",
    "acc_body_ms2": "AccB",
}
"""Channel -> field of LAP; all labels of a type have 64 bytes together."""
_UNITS = {"mm": ("M", "mm"), "dps": ("k", "deg/s"), "kmh": ("K", "km/h"), "ms2": ("o", "m/s/s")}
"""Ending of a channel's name -> letter and text of its unit in the log, ArduPilot's own where it has one."""
_FIXED = {"c": 100, "C": 100, "e": 100, "E": 100, "L": 10_000_000}
"""Letters of fixed-point types: what their numbers are divided by."""
_COUNT = re.compile(rb"strokebench lap of (\d{1,9}) samples")


def read(path: Path, channel_map: ChannelMap | None = None) -> Recording:
    """Read a log; what is no record of a defined type with another after it is damage.

    The format has no checksums: a damaged value is found only if it is no number, a damaged time only if the
    clock jumps. A file cut between records cannot be told from a shorter one, except where `write` made it.
    Raises LapError if there is no record, and naming what the map wants and the log lacks.
    """
    log = Log(path)
    if channel_map is None:
        return recording(path, _own(log), None, log.damage)
    told = _Told(log)
    signals = {name: _mapped(log, told, row, channel_map.where) for name, row in channel_map.rows.items()}
    return recording(path, signals, channel_map.rate_hz, log.damage)


def _own(log: Log) -> dict[str, Signal]:
    """The channels of a lap that `write` wrote."""
    kind = log.named.get("LAP")
    found = {name: label for name, label in _LABELS.items() if kind is not None and label in kind.labels}
    if kind is None or not found or not log.count(kind):
        raise LapError(f"{log.path}: no LAP with {listed(_LABELS.values())}; a map may name {log.present()}")
    said = _COUNT.search(log.data[:_NOTE_WITHIN].tobytes())
    if said is not None and int(said[1]) != log.count(kind):
        log.damage.append(f"{log.count(kind)} samples are left of the {int(said[1])} that were written")
    strange = [label for label in kind.labels if label != "TimeUS" and label not in _LABELS.values()]
    if strange:
        log.damage.append(f"LAP has {listed(strange)}, which is no channel's")
    t_us = _clock(log, kind, str(log.path))
    signals = {}
    for name, label in found.items():
        row = Row(name, f"LAP.{label}")
        values = element(log.field(kind, label), None, row, str(log.path))
        signals[name] = Signal(row, "LAP", t_us, values, unit=name)
    return signals


_NOTE_WITHIN = 2000  # bytes: definitions come first


class _Told:
    """What a log says of its own fields: units, multipliers, which field is the instance."""

    def __init__(self, log: Log) -> None:
        self.units = _columns(log, "UNIT", "Id", "Label")
        self.multipliers = _columns(log, "MULT", "Id", "Mult")
        self.unit_letters = _columns(log, "FMTU", "FmtType", "UnitIds")
        self.multiplier_letters = _columns(log, "FMTU", "FmtType", "MultIds")

    def unit(self, kind: Definition, label: str) -> str:
        """The unit's text, of the number times its multiplier; empty if the log says none."""
        text = self.units.get(_letter(self.unit_letters, kind, label), b"")
        return text.decode("latin-1") if isinstance(text, bytes) else ""

    def multiplier(self, kind: Definition, label: str) -> float:
        """What the number is to be multiplied by; 0 in the log means that nothing is."""
        found = self.multipliers.get(_letter(self.multiplier_letters, kind, label), 1.0)
        return float(found) if isinstance(found, float) and np.isfinite(found) and found else 1.0

    def instance(self, kind: Definition) -> str | None:
        """The field that counts instances."""
        for label in kind.labels:
            if _letter(self.unit_letters, kind, label) == ord("#"):
                return label
        return "I" if "I" in kind.labels else None


def _columns(log: Log, name: str, key: str, value: str) -> dict[int, Any]:
    kind = log.named.get(name)
    if kind is None or not {key, value} <= set(kind.labels):
        return {}
    keys, values = log.field(kind, key), log.field(kind, value)
    if keys.dtype.kind not in "iu" or keys.ndim > 1:
        return {}
    return dict(zip(keys.tolist(), values.tolist(), strict=True))


def _letter(table: dict[int, Any], kind: Definition, label: str) -> int:
    letters = table.get(kind.kind, b"")
    place = kind.labels.index(label)
    return letters[place] if isinstance(letters, bytes) and place < len(letters) else -1


def _mapped(log: Log, told: _Told, row: Row, where: str) -> Signal:
    at = address(row, where)
    kind = log.named.get(at.kind)
    if kind is None or not log.count(kind):
        raise LapError(f"{where}: {at.kind} is not in {log.path}; that has {log.present()}")
    if at.field not in kind.labels:
        raise LapError(f"{where}: {at.kind} has no {at.field}; it has {listed(kind.labels)}")
    values = element(log.field(kind, at.field), at.index, row, where)
    if kind.letter(at.field) in _FIXED:
        values /= _FIXED[kind.letter(at.field)]
    elif row.unit is None:
        values *= told.multiplier(kind, at.field)
    t_us = _clock(log, kind, where)
    instance = told.instance(kind)
    if instance is not None:
        numbers = log.field(kind, instance).astype(str)
        mine = one(numbers, at.instance, f"{where}: the instance, {instance}, of {at.kind} in {log.path}")
        t_us, values = t_us[mine], values[mine]
    elif at.instance is not None:
        raise LapError(f"{where}: {at.kind} has no instances, so that [{at.instance}] is none of them")
    return Signal(row, (at.kind, at.instance), t_us, values, told.unit(kind, at.field))


def _clock(log: Log, kind: Definition, where: str) -> NDArray[np.uint64]:
    """The times of a type's records in microseconds."""
    millis = "T" if "Week" in kind.labels else "TimeMS"
    for label, letters, us in (("TimeUS", "Qq", 1), (millis, "Ii", 1000)):
        if label in kind.labels and kind.letter(label) in letters:
            times = log.field(kind, label).astype(np.uint64)  # negative ones become too late
            return np.minimum(times, np.uint64(LATEST_US + 1)) * np.uint64(us)
    raise LapError(f"{where}: {kind.name} has no TimeUS or {millis}; it has {listed(kind.labels)}")


def write(lap: Lap, path: Path) -> None:
    """Write a lap, values as they are and times in microseconds; the same lap gives the same bytes.

    Raises LapError for samples less than a microsecond apart.
    """
    t_us = whole_us(lap)
    labels = tuple(_LABELS[name] for name in lap.channels)
    unit = Definition(130, "UNIT", "QbZ", ("TimeUS", "Id", "Label"))
    mult = Definition(131, "MULT", "Qbd", ("TimeUS", "Id", "Mult"))
    fmtu = Definition(132, "FMTU", "QBNN", ("TimeUS", "FmtType", "UnitIds", "MultIds"))
    note = Definition(133, "MSG", "QZ", ("TimeUS", "Message"))
    laps = Definition(134, "LAP", "Q" + "d" * len(labels), ("TimeUS", *labels))
    itself = Definition(FMT, "FMT", "BBnNZ", ("Type", "Length", "Name", "Format", "Columns"))
    letters = "".join(_UNITS[name.rsplit("_", 1)[1]][0] for name in lap.channels)
    table = {letter: text for letter, text in (("s", "s"), *_UNITS.values())}
    start = int(t_us[0])
    with path.open("xb") as file:
        for definition in (itself, unit, mult, fmtu, note, laps):
            file.write(definition_record(definition))
        for letter, text in table.items():
            file.write(_record(unit, start, ord(letter), text.encode()))
        for letter, factor in (("-", 0.0), ("F", 1e-6)):
            file.write(_record(mult, start, ord(letter), factor))
        file.write(_record(fmtu, start, laps.kind, f"s{letters}".encode(), b"F" + b"-" * len(labels)))
        file.write(_record(note, start, f"strokebench lap of {len(t_us)} samples".encode()))
        rows = np.zeros(len(t_us), laps.layout())
        rows["head"], rows["TimeUS"] = head(laps.kind), t_us
        for name, values in lap.channels.items():
            rows[_LABELS[name]] = values
        file.write(rows.tobytes())


def _record(definition: Definition, *values: int | float | bytes) -> bytes:
    return np.array((head(definition.kind), *values), definition.layout()).tobytes()
