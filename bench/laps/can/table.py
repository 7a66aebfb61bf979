"""CAN logs of python-can's own .csv, known by its header line.

Belongs here: that header. Never: a lap table, which is `bench.laps.csv`, a signal. It names no bus.
"""

from pathlib import Path

from bench.laps.can import log as can_log
from bench.laps.can import text as can_text
from bench.laps.channel_map import ChannelMap
from bench.laps.recording import Recording

HEADER = ("timestamp", "arbitration_id", "extended", "remote", "error", "dlc", "data")


def read(path: Path, channel_map: ChannelMap | None = None) -> Recording:
    """Read a log through the map's DBC; times as they stand in it."""
    import can

    return can_log.recording(path, can_text.read(path, can.CSVReader, is_header), channel_map)


def is_header(line: str) -> bool:
    """Whether a file that begins with `line` is such a log."""
    return tuple(name.strip() for name in line.split(",")) == HEADER
