"""What the tabular formats share: which columns a lap file has, and seconds to nanoseconds and back.

Belongs here: checks on names and on time. Never: a byte of a file.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from bench.errors import LapError
from bench.laps.channel_map import ChannelMap, Row
from bench.laps.lap import Lap
from bench.laps.recording import Recording, Track
from dbc import CHANNELS

TIME = "t_s"


def wanted(names: Sequence[str], channel_map: ChannelMap | None, where: str) -> dict[str, Row]:
    """The columns to read, by name, each with the channel it becomes; the time's row has the channel `t_s`.

    Without a map a file has `t_s` and some of CHANNELS and nothing else, each once; with one, what it maps.
    Raises LapError naming the column that is missing, unknown or there twice.
    """
    if channel_map is None:
        _check_names(names, where)
        return {name: Row(name, name, "s" if name == TIME else None) for name in names}
    time = channel_map.time or Row(TIME, TIME, "s")
    rows = {}
    for row in (time, *channel_map.rows.values()):
        if names.count(row.signal) != 1:
            found = (
                "appears twice" if row.signal in names else f"is not there; the file has {', '.join(names)}"
            )
            raise LapError(
                f"{where}: column {row.signal}, mapped to {row.channel} by {channel_map.where}, {found}"
            )
        if row.signal in rows:
            raise LapError(f"{channel_map.where}: column {row.signal} is mapped twice")
        rows[row.signal] = row
    return rows


def _check_names(names: Sequence[str], where: str) -> None:
    known = f"the known ones are {', '.join((TIME, *CHANNELS))}"
    seen = set()
    for name in names:
        if name in seen:
            raise LapError(f"{where}: column {name} appears twice")
        seen.add(name)
        if name != TIME and name not in CHANNELS:
            raise LapError(f"{where}: unknown column {name!r}; {known}")
    if TIME not in seen:
        raise LapError(f"{where}: no column {TIME}; it has {', '.join(names)}")
    if len(seen) == 1:
        raise LapError(f"{where}: no channel beside {TIME}; {known}")


def recording_of(
    columns: Mapping[str, NDArray[np.float64]], rows: Mapping[str, Row], where: str, source: str
) -> Recording:
    """A recording of float64 (samples,) columns, the time rounded to whole nanoseconds.

    Raises LapError naming `where`, the column and the row (counted from 1) of what is not finite.
    """
    for name, values in columns.items():
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            raise LapError(
                f"{where}: row {bad[0] + 1}, column {name}: {values[bad[0]]} is not a finite number"
            )
    time = next(row for row in rows.values() if row.channel == TIME)
    t_s = columns[time.signal]
    if len(t_s) == 0:
        raise LapError(f"{where}: no samples")
    if time.unit != "s" or time.scale != 1.0 or time.offset:
        t_s = time.convert(t_s, None, where)
    far = np.flatnonzero(np.abs(t_s) > _FARTHEST_S)
    if far.size:
        raise LapError(
            f"{where}: row {far[0] + 1}, column {time.signal}: {t_s[far[0]]:g} s is beyond any lap"
        )
    t_ns = np.rint(t_s * 1e9).astype(np.int64)
    tracks = {
        # a column that bears the channel's name bears its unit
        row.channel: Track(
            t_ns,
            columns[name]
            if name == row.channel and row.unit is None
            else row.convert(columns[name], None, where),
        )
        for name, row in rows.items()
        if row.channel != TIME
    }
    return Recording(where, source, tracks)


_FARTHEST_S = 9.2e9  # int64 nanoseconds


def columns_from_lap(lap: Lap) -> dict[str, NDArray[np.float64]]:
    """Columns in file order, float64 (samples,), time in seconds.

    Raises LapError if a time does not come back to the same nanosecond from float64 seconds (beyond 50 days).
    """
    t_s = lap.t_ns / 1e9
    lost = np.flatnonzero(np.rint(t_s * 1e9).astype(np.int64) != lap.t_ns)
    if lost.size:
        raise LapError(
            f"time {lap.t_ns[lost[0]]} ns does not fit a column of seconds; shift the lap towards 0"
        )
    return {TIME: t_s, **lap.channels}
