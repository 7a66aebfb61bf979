"""Laps as Parquet: the smallest and fastest of the formats, and exact."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet
from numpy.typing import NDArray

from bench.errors import LapError
from bench.laps.channel_map import ChannelMap
from bench.laps.columns import columns_from_lap, recording_of, wanted
from bench.laps.lap import Lap
from bench.laps.recording import Recording


def read(path: Path, channel_map: ChannelMap | None = None) -> Recording:
    """Read a table; strict: the columns used are numeric and without nulls."""
    try:
        with pa.parquet.ParquetFile(path) as file:
            rows = wanted(file.schema_arrow.names, channel_map, str(path))
            # Threads would not survive a fork of the campaign's workers.
            table = file.read(columns=list(rows), use_threads=False)
    except (pa.ArrowException, ValueError) as error:  # ValueError: damaged names are not UTF-8
        reason = " ".join(str(error).split())
        raise LapError(f"{path}: not a Parquet file, or cut short: {reason}") from None
    columns = {name: _column(path, name, table[name]) for name in table.column_names}
    return recording_of(columns, rows, str(path), path.name)


def write(lap: Lap, path: Path) -> None:
    """Write a lap: float64 columns, time in seconds; the same lap gives the same bytes."""
    pa.parquet.write_table(
        pa.table(columns_from_lap(lap)),
        path,
        # Measured values repeat no value but share exponents: bytes of one rank, side by side, compress.
        compression="zstd",
        use_dictionary=False,
        use_byte_stream_split=True,
    )


def _column(path: Path, name: str, column: pa.ChunkedArray) -> NDArray[np.float64]:
    kind = column.type
    if not (pa.types.is_floating(kind) or pa.types.is_integer(kind)):
        raise LapError(f"{path}: column {name} holds {kind}, not numbers")
    if column.null_count:
        row = next(k for k, cell in enumerate(column, 1) if not cell.is_valid)
        raise LapError(f"{path}: row {row}, column {name}: empty")
    return column.to_numpy().astype(np.float64)
