"""The recorder: what went over the bus, as a log file of the format its suffix names. It is rim: it writes.

Belongs here: the formats and the promise that the same frames give the same bytes. Never: what a frame means.

No file carries the time of day: bus time 0 is 0 s of a measurement that starts at the epoch. What remains is
the libraries' hand: .blf and .mf4 are deflated, and another zlib may deflate the same frames otherwise; .mf4
names the asammdf version in its history. candump and .asc round to microseconds, .blf keeps nanoseconds.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bench.errors import RecordError
from bench.mf4 import START, forget_save_time
from bench.whole import check_writable, whole
from targets.ecu import Frame

if TYPE_CHECKING:
    import can

Row = tuple[int, Frame, str]
"""(bus time in ns, frame, name of the node that sent it)."""

LOGGER = "MDLOG"
"""The node that records: its own frames are marked as sent, all others as received."""

NOTES = "BENCH"
"""Who sends what only recordings hold: its frames have a channel of their own, they never were on the bus."""

CHANNELS = {"bus": "vcan0", "notes": "bench1"}
"""The channels' names in candump logs; channels 1 and 2 in the other formats."""


def check_target(path: Path) -> None:
    """Raise now what `record` would raise after the run: before an hour of work, not after."""
    _writer(path)
    check_writable(path)


def record(path: Path, rows: Iterable[Row]) -> None:
    """Write `rows`, ordered in time, to `path`: .log (candump), .asc, .blf, or .mf4 (needs asammdf).

    The file appears whole or not at all. Raises RecordError for another suffix, for a file that cannot be
    written, and for .mf4 without asammdf.
    """
    write = _writer(path)
    with whole(path) as part:
        write(part, list(rows))


def _writer(path: Path) -> Callable[[Path, Sequence[Row]], None]:
    suffix = Path(path).suffix.lower()
    if suffix not in _WRITERS:
        raise RecordError(f"{path}: unknown suffix {suffix!r}; the known ones are {', '.join(_WRITERS)}")
    if suffix == ".mf4" and find_spec("asammdf") is None:
        raise RecordError(f"{path}: needs asammdf: pip install 'strokebench[mdf]'")
    return _WRITERS[suffix]


def _messages(rows: Sequence[Row], late_s: float = 0.0, named: bool = False) -> "Iterator[can.Message]":
    """python-can's messages; `late_s` is added to every time, the channel is a name if `named`."""
    import can

    for t_ns, frame, node in rows:
        yield can.Message(
            timestamp=t_ns / 1e9 + late_s,
            arbitration_id=frame.id,
            is_extended_id=frame.extended,
            is_rx=node not in (LOGGER, NOTES),
            data=frame.data,
            channel=CHANNELS["notes" if node == NOTES else "bus"] if named else int(node == NOTES),
        )


def _log(part: Path, rows: Sequence[Row]) -> None:
    import can

    with part.open("w", encoding="ascii", newline="\n") as file, can.CanutilsLogWriter(file) as writer:
        for message in _messages(rows, named=True):
            writer.on_message_received(message)


def _asc(part: Path, rows: Sequence[Row]) -> None:
    import can

    with part.open("w", encoding="ascii", newline="\n") as file, can.ASCWriter(file) as writer:
        # without an event at 0 the writer would count from the first frame; it writes this one twice
        writer.log_event("Start of measurement", 0.0)
        for message in _messages(rows):
            writer.on_message_received(message)
    # the two dates of the header are today's and, in local time, the epoch's
    text = part.read_text(encoding="ascii")
    head, begin, body = text.partition("Begin Triggerblock ")
    start = "Thu Jan 01 00:00:00.000 1970\n"
    head = f"date {start}" + head.split("\n", 1)[1]
    first, _, rest = body.split("\n", 1)[1].split("\n", 2)
    part.write_text(f"{head}{begin}{start}{first}\n{rest}", encoding="ascii", newline="\n")


def _blf(part: Path, rows: Sequence[Row]) -> None:
    import can

    with part.open("w+b") as file, can.BLFWriter(file, compression_level=6) as writer:
        # the writer would count from the first frame's millisecond
        writer.start_timestamp = 0.0
        # and it truncates to nanoseconds what a float may hold a hair below: half a nanosecond more is safe
        for message in _messages(rows, late_s=0.5e-9):
            writer.on_message_received(message)


def _mf4(part: Path, rows: Sequence[Row]) -> None:
    """One event group `CAN_DataFrame` of ASAM's bus logging; by asammdf itself, which takes whole arrays.

    python-can's own writer stamps the time of day and appends frame by frame.
    """
    from asammdf import MDF, Signal
    from asammdf.blocks.v4_blocks import SourceInformation
    from asammdf.blocks.v4_constants import BUS_TYPE_CAN, SOURCE_BUS

    fields = [("BusChannel", "u1"), ("ID", "<u4"), ("IDE", "u1"), ("DLC", "u1"), ("DataLength", "u1")]
    fields += [("Dir", "u1"), ("EDL", "u1"), ("BRS", "u1"), ("ESI", "u1")]
    dtype = [(f"CAN_DataFrame.{name}", kind) for name, kind in fields]
    samples = np.zeros(len(rows), dtype=[*dtype, ("CAN_DataFrame.DataBytes", "u1", (8,))])
    frames = [frame for _, frame, _ in rows]
    lengths = [len(frame.data) for frame in frames]
    data = b"".join(frame.data.ljust(8, b"\0") for frame in frames)
    samples["CAN_DataFrame.BusChannel"] = [1 + (node == NOTES) for _, _, node in rows]
    samples["CAN_DataFrame.ID"] = [frame.id for frame in frames]
    samples["CAN_DataFrame.IDE"] = [frame.extended for frame in frames]
    samples["CAN_DataFrame.DLC"] = samples["CAN_DataFrame.DataLength"] = lengths
    samples["CAN_DataFrame.Dir"] = [node in (LOGGER, NOTES) for _, _, node in rows]
    samples["CAN_DataFrame.DataBytes"] = np.frombuffer(data, dtype=np.uint8).reshape(-1, 8)
    source = SourceInformation(source_type=SOURCE_BUS, bus_type=BUS_TYPE_CAN)
    times_s = np.array([t_ns for t_ns, _, _ in rows], dtype=np.float64) / 1e9
    with MDF(version="4.10") as mdf, part.open("w+b") as file:
        mdf.header.start_time = START
        mdf.append(Signal(samples=samples, timestamps=times_s, name="CAN_DataFrame", source=source))
        mdf.save(file, compression=2)
    forget_save_time(part)


_WRITERS: dict[str, Callable[[Path, Sequence[Row]], None]] = {
    ".log": _log,
    ".asc": _asc,
    ".blf": _blf,
    ".mf4": _mf4,
}
