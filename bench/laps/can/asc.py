"""CAN logs of Vector's text format, .asc, through python-can's reader.

Belongs here: which lines of such a log carry no frame, what python-can does not say of it. Never: a signal.
A bus is the channel number as the file shows it. Times count from the start of the measurement; the date,
which names no time zone, is left alone.
"""

import re
from pathlib import Path
from typing import TYPE_CHECKING

from bench.errors import LapError
from bench.laps.can import log as can_log
from bench.laps.can import text as can_text
from bench.laps.can.text import Lines
from bench.laps.channel_map import ChannelMap
from bench.laps.lap import Lap
from bench.laps.recording import Recording

if TYPE_CHECKING:
    import can

_HEAD = re.compile(r"\s*(date\b|base\b|//|$)", re.I)
_RELATIVE = re.compile(r"\s*base\s+\w+\s+timestamps\s+relative", re.I)
_BEGIN = re.compile(r"\s*begin\s+triggerblock", re.I)
_END = re.compile(r"\s*end\s+triggerblock", re.I)
_EVENT = re.compile(
    r"\s*\d+\.\d+\s+(?:\d+\s+(?:Statistic|J1939TP|OverloadFrame|Status)|(?!CANFD\s)[a-z][\w-]).*", re.I | re.S
)
"""Of no channel, or of one and no frame: statistics, chip status, triggers, variables, other buses."""
_FRAME = re.compile(r"\s[RT]x\s")


def read(path: Path, channel_map: ChannelMap | None = None) -> Recording:
    """Read a log through the map's DBC; to the digits the file has, at most nanoseconds.

    Raises LapError for time stamps that count from the event before.
    """
    blocks: list[str] = []

    def silent(line: str) -> bool:
        if _BEGIN.match(line) or _END.match(line):
            blocks.append(line)
            return True
        return bool(_EVENT.match(line)) or not (_FRAME.search(line) or line.lstrip()[:1].isdigit())

    def open_end() -> tuple[str, ...]:
        cut = blocks and _BEGIN.match(blocks[-1])
        return ("no End TriggerBlock: the log was cut short, or not closed",) if cut else ()

    frames = can_text.read(path, _reader, silent, shift=1, tail=open_end)
    return can_log.recording(path, frames, channel_map)


def write(lap: Lap, path: Path) -> None:
    """Write what the logger would send during `lap`; microseconds, channel 1."""
    can_log.write(lap, path, ".asc")


def _reader(lines: Lines) -> "can.ASCReader":
    """python-can's reader, which takes the first line that is no header for one, though it may be a frame."""
    import can

    head = []
    for line in lines:
        if _RELATIVE.match(line):
            raise LapError(f"{lines.where}: line {lines.number}: relative time stamps; export absolute ones")
        head.append((lines.number, line))
        if not _HEAD.match(line):
            break
    lines.back([*head[:-1], (lines.number, "\n"), *head[-1:]])
    return can.ASCReader(lines)
