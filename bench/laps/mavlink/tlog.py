"""MAVLink telemetry logs (.tlog), read through a channel map, and laps written as one.

    [channels.pitch_rate_dps]
    signal = "ATTITUDE.pitchspeed"            # the unit is the dialect's, rad/s
    bus = 1       # the sending system, or 256 x system + component; left out: the only sender there is

    [channels.fork_stroke_mm]
    signal = "NAMED_VALUE_FLOAT[fork].value"  # in brackets a name, or an instance's number: RAW_IMU[1].xgyro
    unit = "mm"

    [channels.rear_stroke_mm]
    signal = "DEBUG_FLOAT_ARRAY[strokes].data[3]"
    unit = "mm"

The clock is the messages' own, `time_usec` or `time_boot_ms`, if all that are mapped have one and it counts
from the same event; else the log's stamps, which say when the ground station heard each message.
FIDELITY: stamps have the radio link's delay and jitter in them, and no checksum; nothing corrects them.

Without a map a lap is read from messages DEBUG_FLOAT_ARRAY named `strokes`, as `write` makes them: data[k] is
channel k of CHANNELS in its own unit, NaN throughout where the lap lacks it.

Belongs here: messages, clocks, channels. Never: a packet's framing, which is `bench.laps.mavlink.framing`'s.
"""

import re
from collections.abc import Hashable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.errors import LapError
from bench.laps.channel_map import ChannelMap, Row
from bench.laps.lap import Lap
from bench.laps.mavlink.framing import dialect, find, layout, pack, unpack
from bench.laps.mavlink.messages import (
    Signal,
    address,
    between,
    content,
    element,
    listed,
    one,
    recording,
    whole_us,
)
from bench.laps.recording import Recording
from dbc import CHANNELS

_ARRAY, _OWN = "DEBUG_FLOAT_ARRAY", "strokes"
_SENDER = 1 << 8 | 191  # system 1; component 191: an onboard computer
_COUNT = re.compile(rb"strokebench lap of (\d{1,9}) samples")
_CLOCKS = {"time_usec": 1, "time_boot_ms": 1000}
_YEARS_US = 10**15
"""A `time_usec` beyond 31 years counts from 1970, one below from the system's start: MAVLink's own rule."""
_AT_ONCE = 100_000  # messages packed at once: 25 MB
_UNITS = {"mG": "mg"}  # as the dialect writes them: as channel maps do


@dataclass(frozen=True)
class _Stream:
    """Messages of one type, instance and sender: heard_us, the log's stamps (messages,), and their fields."""

    key: Hashable
    heard_us: NDArray[np.uint64]
    fields: NDArray

    def clock(self) -> tuple[str, NDArray[np.uint64]] | None:
        """What the messages' own clock counts from, and its microseconds (messages,); None without one."""
        for field, us in _CLOCKS.items():
            if field in (self.fields.dtype.names or ()) and self.fields[field].any():
                t_us = self.fields[field].astype(np.uint64) * np.uint64(us)
                return "1970" if np.median(t_us) > _YEARS_US else "start", t_us
        return None


class _Log:
    """The packets of one file, unpacked where they are asked for."""

    def __init__(self, path: Path) -> None:
        self.path, self.data = path, content(path)
        self.packets = find(self.data)
        kinds = self.packets.kind
        known = np.isin(kinds, list(dialect().by_id))
        if not known.any():
            raise LapError(f"{path}: no MAVLink message in its {len(self.data)} bytes")
        self.present = [dialect().by_id[kind].msgname for kind in np.unique(kinds[known]).tolist()]
        self.damage = list(between(self.packets.start, self.packets.end, len(self.data)))
        unknown = np.flatnonzero(~known)
        if unknown.size:
            self.damage.append(
                f"messages of types that the dialect lacks are passed over: {unknown.size}, the first, type "
                f"{kinds[unknown[0]]}, at byte {self.packets.start[unknown[0]]}"
            )

    def stream(self, kind: str, instance: str | None, bus: int | None, where: str) -> _Stream:
        """The messages meant. Raises LapError if there are none, or of several instances or senders."""
        message = dialect().by_name.get(kind)
        if message is None:
            raise LapError(f"{where}: {kind} is no message of MAVLink's ardupilotmega dialect")
        if kind not in self.present:
            raise LapError(f"{where}: {kind} is not in {self.path}; that has {listed(self.present)}")
        chosen = np.flatnonzero(self.packets.kind == message.id)
        senders = self.packets.source[chosen]
        if bus is not None and bus <= 0xFF:
            system = one(senders >> 8, bus, f"{where}: the system of {kind} in {self.path}")
            chosen, senders, bus = chosen[system], senders[system], None
        chosen = chosen[
            one(senders, bus, f"{where}: `bus`, 256 x system + component, of {kind} in {self.path}")
        ]
        fields = unpack(self.data, self.packets, chosen, message.id)
        by = "name" if "name" in message.fieldnames else message.instance_field
        if by is not None:
            mine = one(_texts(fields[by]), instance, f"{where}: the {by} of {kind} in {self.path}")
            chosen, fields = chosen[mine], fields[mine]
        elif instance is not None:
            raise LapError(f"{where}: {kind} has no instances, so that [{instance}] is none of them")
        stamps = self.data[self.packets.start[chosen, None] + np.arange(8)]
        heard_us = np.ascontiguousarray(stamps).view(">u8")[:, 0].astype(np.uint64)
        return _Stream((kind, instance, bus), heard_us, fields)


def read(path: Path, channel_map: ChannelMap | None = None) -> Recording:
    """Read a log; what is no packet with a right checksum, or of a type not known, is damage.

    A file cut between two packets cannot be told from a shorter one, except where `write` made it; nor a
    damaged stamp from a bad clock.
    Raises LapError without pymavlink, without any packet, and naming what the map wants and the log lacks.
    """
    log = _Log(path)
    if channel_map is None:
        found = _own(log)
    else:
        found = [_mapped(log, row, channel_map.where) for row in channel_map.rows.values()]
    clocks = [stream.clock() for _, stream, _, _ in found]
    own = None not in clocks and len({clock[0] for clock in clocks if clock}) == 1
    signals = {}
    for (row, stream, values, unit), clock in zip(found, clocks, strict=True):
        t_us = clock[1] if own and clock else stream.heard_us
        signals[row.channel] = Signal(row, stream.key, t_us, values, unit)
    return recording(path, signals, None if channel_map is None else channel_map.rate_hz, log.damage)


_Found = tuple[Row, _Stream, NDArray[np.float64], str | None]


def _mapped(log: _Log, row: Row, where: str) -> _Found:
    at = address(row, where)
    stream = log.stream(at.kind, at.instance, row.bus, where)
    if at.field not in (stream.fields.dtype.names or ()):
        raise LapError(
            f"{where}: {at.kind} has no {at.field}; it has {listed(stream.fields.dtype.names or ())}"
        )
    values = element(stream.fields[at.field], at.index, row, where)
    unit = dialect().by_name[at.kind].fieldunits_by_name.get(at.field)
    return row, stream, values, _UNITS.get(unit, unit)


def _own(log: _Log) -> list[_Found]:
    """The channels of a lap that `write` wrote."""
    try:
        stream = log.stream(_ARRAY, _OWN, None, "a lap without a channel map")
    except LapError as error:
        raise LapError(f"{log.path}: {error}; a channel map says what is what") from None
    data = stream.fields["data"][:, : len(CHANNELS)].astype(np.float64)
    said = _COUNT.search(log.data[:200].tobytes())
    if said is not None and int(said[1]) != len(data):
        log.damage.append(f"{len(data)} samples are left of the {int(said[1])} that were written")
    present = [k for k in range(len(CHANNELS)) if not np.isnan(data[:, k]).all()]
    if not present:
        raise LapError(f"{log.path}: {_ARRAY} {_OWN} holds no number")
    return [
        (Row(CHANNELS[k], f"{_ARRAY}[{_OWN}].data[{k}]"), stream, data[:, k], CHANNELS[k]) for k in present
    ]


def write(lap: Lap, path: Path) -> None:
    """Write a lap, values rounded to float32 and times to microseconds; the same lap gives the same bytes.

    Raises LapError for samples less than a microsecond apart and values beyond float32.
    """
    t_us = whole_us(lap)
    data = np.full((len(t_us), len(CHANNELS)), np.nan, dtype="<f4")
    for name, values in lap.channels.items():
        with np.errstate(over="ignore"):
            data[:, CHANNELS.index(name)] = values
        lost = np.flatnonzero(np.isinf(data[:, CHANNELS.index(name)]))
        if lost.size:
            raise LapError(
                f"channel {name} is {values[lost[0]]:g} at sample {lost[0]}: more than float32 holds"
            )
    note = np.zeros(1, layout(dialect().by_name["STATUSTEXT"]))
    note["severity"], note["text"] = 6, f"strokebench lap of {len(t_us)} samples".encode()
    with path.open("xb") as file:
        file.write(pack("STATUSTEXT", t_us[:1], note, 0, _SENDER))
        for first in range(0, len(t_us), _AT_ONCE):
            part = slice(first, first + _AT_ONCE)
            floats = np.zeros(len(t_us[part]), layout(dialect().by_name[_ARRAY]))
            floats["time_usec"], floats["name"] = t_us[part], _OWN.encode()
            floats["data"][:, : len(CHANNELS)] = data[part]
            file.write(pack(_ARRAY, t_us[part], floats, 1 + first, _SENDER))


def _texts(values: NDArray) -> NDArray[np.str_]:
    return np.char.decode(values, "latin-1") if values.dtype.kind == "S" else values.astype(str)
