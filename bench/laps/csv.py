"""Laps as CSV: one header line, commas, points, UTF-8.

The suffix is also that of a CAN log of python-can's, known by its header and read by `bench.laps.can.table`.
Pyarrow parses; where it refuses, the file is read again line by line to say which line and value it was.
"""

import csv
import math
from collections.abc import Container
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv

from bench.errors import LapError
from bench.laps.can import table as can_csv
from bench.laps.channel_map import ChannelMap
from bench.laps.columns import columns_from_lap, recording_of, wanted
from bench.laps.lap import Lap
from bench.laps.recording import Recording


def read(path: Path, channel_map: ChannelMap | None = None) -> Recording:
    """Read a table, or a CAN log; strict: every row has every column, each cell used is a finite number."""
    names = _header(path)
    if tuple(names) == can_csv.HEADER:
        return can_csv.read(path, channel_map)
    rows = wanted(names, channel_map, str(path))
    try:
        # Opened here: Arrow takes no name that is not UTF-8.
        with path.open("rb") as file:
            table = pa.csv.read_csv(
                file,
                # Threads would not survive a fork of the campaign's workers.
                read_options=pa.csv.ReadOptions(use_threads=False, column_names=names, skip_rows=1),
                convert_options=pa.csv.ConvertOptions(
                    column_types=dict.fromkeys(rows, pa.float64()), null_values=[], include_columns=list(rows)
                ),
            )
    except pa.ArrowException as error:
        _explain(path, names, rows)
        raise LapError(f"{path}: {' '.join(str(error).split())}") from None
    columns = {name: table[name].to_numpy() for name in rows}
    if not all(np.isfinite(values).all() for values in columns.values()):
        _explain(path, names, rows)
    return recording_of(columns, rows, str(path), path.name)


def write(lap: Lap, path: Path) -> None:
    """Write a lap with as many digits as bring back the same float64."""
    columns = columns_from_lap(lap)
    with path.open("xb") as file:
        file.write((",".join(columns) + "\n").encode())
        pa.csv.write_csv(pa.table(columns), file, pa.csv.WriteOptions(include_header=False))


def _header(path: Path) -> list[str]:
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            line = file.readline(_LONGEST_HEADER)
    except UnicodeDecodeError as error:
        raise _not_text(path, error) from None
    return [name.strip() for name in next(csv.reader([line.rstrip("\r\n")]), [])]


_LONGEST_HEADER = 10_000  # a file without line ends is not read whole to say that it has no header


def _explain(path: Path, names: list[str], used: Container[str]) -> None:
    """Raise LapError for the first line that is not what a lap wants, if there is one."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            lines = csv.reader(file)
            next(lines)
            line = 1
            for row in lines:
                line = lines.line_num
                where = f"{path}: line {line}"
                if row and len(row) != len(names):
                    raise LapError(f"{where} has {len(row)} cells, the header {len(names)}")
                for name, cell in zip(names, row, strict=False):
                    if name in used and not _is_number(cell):
                        raise LapError(f"{where}, column {name}: {cell[:40]!r} is not a finite number")
            if line == 1:
                raise LapError(f"{path}: no samples")
    except UnicodeDecodeError as error:
        raise _not_text(path, error) from None
    except csv.Error as error:
        raise LapError(f"{path}: line {line + 1}: {error}") from None


def _is_number(cell: str) -> bool:
    try:
        return math.isfinite(float(cell))
    except ValueError:
        return False


def _not_text(path: Path, error: UnicodeDecodeError) -> LapError:
    return LapError(f"{path}: not UTF-8 text: byte 0x{error.object[error.start]:02x}")
