"""Lap files, chosen by suffix: which formats there are, and what is true of all of them.

Belongs here: the table of formats, refusing what is no file, writing that leaves nothing half-written.
Never: the inside of a format; each has its own module with `read(path, channel_map) -> Recording` and, where
laps can be written in it, `write(lap, path)`.
"""

import os
from importlib import import_module
from pathlib import Path
from types import ModuleType

from bench.errors import LapError
from bench.laps.channel_map import ChannelMap
from bench.laps.lap import Lap
from bench.laps.timebase import lap_of

FORMATS = {
    ".csv": "bench.laps.csv",
    ".parquet": "bench.laps.parquet",
    ".mf4": "bench.laps.mdf.mf4",
    ".log": "bench.laps.can.candump",
    ".asc": "bench.laps.can.asc",
    ".blf": "bench.laps.can.blf",
    ".trc": "bench.laps.can.trc",
    ".db": "bench.laps.can.db",
    ".gz": "bench.laps.gz",
    ".tlog": "bench.laps.mavlink.tlog",
    ".bin": "bench.laps.mavlink.dataflash",
    ".sst": "bench.laps.sufni",
}
"""File suffix -> the module that knows the format."""


def format_of(path: Path) -> ModuleType:
    """Return the module for `path`'s suffix; LapError naming the known suffixes if there is none."""
    name = FORMATS.get(path.suffix.lower())
    if name is None:
        raise LapError(f"{path}: unknown suffix {path.suffix!r}; the known ones are {', '.join(FORMATS)}")
    return import_module(name)


def read_lap(path: Path, channel_map: ChannelMap | None = None, repair: bool = False) -> Lap:
    """Read a lap; its source is the file's name, its `damage` what was found wrong and not fatal.

    channel_map: which signals of the file are which channels; None: the file's own names are the channels'.
    repair: mend the time base (see `bench.laps.timebase`) instead of refusing or reporting it as it is.
    Raises LapError, one line naming the file and what is wrong where, for a path that is no file, a suffix
    of no known format, and contents that are no lap.
    """
    path = Path(path)
    module = format_of(path)
    if path.is_dir():
        raise LapError(f"{path}: is a folder, not a lap file")
    if not path.exists():
        raise LapError(f"{path}: no such file")
    if not path.is_file():
        raise LapError(f"{path}: not a regular file")
    if path.stat().st_size == 0:
        raise LapError(f"{path}: empty file")
    try:
        recording = module.read(path, channel_map)
    except OSError as error:
        raise LapError(f"{path}: cannot be read: {_reason(error)}") from None
    return lap_of(recording, repair)


def check_writable(path: Path) -> None:
    """Raise LapError unless laps can be written in the format of `path`'s suffix and to its folder."""
    path = Path(path)
    if not hasattr(format_of(path), "write"):
        raise LapError(f"{path}: laps cannot be written as {path.suffix}")
    if path.is_dir():
        raise LapError(f"{path}: is a folder")
    if not path.parent.is_dir():
        raise LapError(f"{path}: no folder {path.parent}")


def write_lap(lap: Lap, path: Path) -> None:
    """Write a lap. The file appears complete or not at all, whatever interrupts the writing.

    Raises LapError naming the file if it cannot be written there or in that format.
    """
    path = Path(path)
    check_writable(path)
    # Beside the target, for a rename is only atomic within one file system.
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        format_of(path).write(lap, part)
        part.replace(path)
    except OSError as error:
        raise LapError(f"{path}: cannot be written: {_reason(error)}") from None
    finally:
        part.unlink(missing_ok=True)


def _reason(error: OSError) -> str:
    return error.strerror or " ".join(str(error).split())
