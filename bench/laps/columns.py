"""What the tabular formats share: which columns a lap file has, and seconds to nanoseconds and back.

Belongs here: checks on names and on time. Never: a byte of a file.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from bench.errors import LapError
from bench.laps.lap import Lap
from dbc import CHANNELS

TIME = "t_s"


def check_names(names: Sequence[str], where: str) -> None:
    """Raise LapError unless `names` are `t_s` and at least one of CHANNELS, each once."""
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


def lap_from_columns(columns: Mapping[str, NDArray[np.float64]], where: str, source: str) -> Lap:
    """Make a lap of float64 (samples,) columns, `t_s` in seconds rounded to whole nanoseconds.

    Raises LapError naming `where`, the column and the row (counted from 1) of what is not finite.
    """
    for name, values in columns.items():
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            raise LapError(
                f"{where}: row {bad[0] + 1}, column {name}: {values[bad[0]]} is not a finite number"
            )
    t_s = columns[TIME]
    if len(t_s) == 0:
        raise LapError(f"{where}: no samples")
    far = np.flatnonzero(np.abs(t_s) > _FARTHEST_S)
    if far.size:
        raise LapError(f"{where}: row {far[0] + 1}, column {TIME}: {t_s[far[0]]:g} s is beyond any lap")
    t_ns = np.rint(t_s * 1e9).astype(np.int64)
    try:
        return Lap(t_ns, {name: values for name, values in columns.items() if name != TIME}, source)
    except LapError as error:
        # The lap names itself by its source; the file's whole path says more.
        raise LapError(f"{where}: {str(error).removeprefix(f'{source}: ')}") from None


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
