"""CAN logs of PEAK's text format, .trc, versions 1.0, 1.1, 1.3, 2.0 and 2.1, through python-can's reader.

Belongs here: which lines of such a log carry no frame, what python-can does not say of it. Never: a signal.
A bus is the bus number as the file shows it, 1 where it shows none. Times count from the log's start.
"""

import re
from pathlib import Path
from typing import TYPE_CHECKING

from bench.errors import LapError
from bench.laps.can import log as can_log
from bench.laps.can import text as can_text
from bench.laps.can.text import Lines
from bench.laps.channel_map import ChannelMap
from bench.laps.recording import Recording

if TYPE_CHECKING:
    import can

VERSIONS = ("1.0", "1.1", "1.3", "2.0", "2.1")
_SILENT = re.compile(r"\s*;|\s*\d+\)?\s+[\d.]+\s+(\d+\s+)?(Warng|Error|ST|EC|ER|EV|FFFFFFFF)\s")
"""Comments, and lines of bus status, error counters, error frames and the user's events."""


def read(path: Path, channel_map: ChannelMap | None = None) -> Recording:
    """Read a log through the map's DBC; to the digits the file has, at most nanoseconds.

    Raises LapError for a version that python-can does not know, which it would take for 1.0.
    """
    frames = can_text.read(path, _reader, lambda line: bool(_SILENT.match(line)))
    return can_log.recording(path, frames, channel_map)


def _reader(lines: Lines) -> "can.TRCReader":
    import can

    head = []
    for line in lines:
        key, _, value = line.partition("=")
        if key == ";$FILEVERSION" and value.strip() not in VERSIONS:
            version = value.strip()[:20]
            raise LapError(f"{lines.where}: version {version!r}; the known ones are {', '.join(VERSIONS)}")
        if key == ";$COLUMNS" and len(set(value.strip().split(","))) <= value.count(","):
            raise LapError(
                f"{lines.where}: line {lines.number}: a column appears twice: {value.strip()[:40]}"
            )
        # added in float64, days since 1899 would cost the microseconds
        if key != ";$STARTTIME":
            head.append((lines.number, line))
        if not line.startswith(";"):
            break
    lines.back(head)
    return can.TRCReader(lines)
