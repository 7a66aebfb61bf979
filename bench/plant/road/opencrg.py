"""OpenCRG files (ASAM OpenCRG 1.2): heights on a grid along a road's reference line.

Belongs here: bytes in, grid out. Never: a path, nor what the road is used for.

Read are LRFI and LDFI (text), KRBI and KDBI (binary), slope and banking of the reference line, and those
modifiers that change a height or a length. Options are hints for an evaluation of another kind, and map
projections and the line's course in the plane do not matter to a straight track; a reference to another file
is refused.

FIDELITY: u is taken as the distance ridden; beside the reference line of a bend it is a little more or less.
"""

import io
from array import array
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.errors import RouteError
from bench.plant.road.crg_header import (
    BINARY,
    TEXT,
    Header,
    long_sections,
    number,
    promised_rows,
    read_header,
)
from bench.plant.road.limits import HIGHEST_M

RECORD_BYTES = 80  # binary data is padded with NaN to a multiple of this
STEEPEST = 10.0  # rise per run: a steeper reference line comes from a damaged file
_KEEP, _ZERO, _NEIGHBOUR = 0, 1, 2  # GRID_NAN_MODE

Array = NDArray[np.float64]


class Grid(NamedTuple):
    """Heights in metres (rows, columns): rows every `step_m` along the road, columns at `v_m`, left positive.

    NaN stands where nothing was measured and the file's modifiers leave it so.
    """

    step_m: float
    v_m: Array
    height_m: Array


def parse(content: bytes) -> Grid:
    """The grid in the bytes of a file. Raises RouteError naming the line, the byte or the row at fault."""
    header = read_header(content)
    step = header.road.get("reference_line_increment", 0.0)
    if not 1e-4 <= step <= 10.0:
        raise RouteError(f"line {header.line}: reference_line_increment is {step:g}, not from 0.0001 to 10 m")
    columns, v = long_sections(header)
    read = _binary if header.layout in BINARY else _text
    table = read(content, header, columns)
    return _modified(header, step, v, table[:, columns], table)


def line(grid: Grid, v_m: float) -> Array:
    """Heights (rows,) along the line `v_m` to the left of the reference line, linear between columns.

    Raises RouteError for a line outside the road, and one that crosses a place where nothing was measured.
    """
    right, left = float(grid.v_m[0]), float(grid.v_m[-1])
    if not right - 1e-6 <= v_m <= left + 1e-6:
        raise RouteError(f"profile_v_m is {v_m:g}, outside the road's {right:g} to {left:g} m")
    k = int(np.clip(np.searchsorted(grid.v_m, v_m, side="right") - 1, 0, len(grid.v_m) - 2))
    part = float(np.clip((v_m - grid.v_m[k]) / (grid.v_m[k + 1] - grid.v_m[k]), 0.0, 1.0))
    # within a micrometre of a column it is that column, whatever its neighbour lacks
    pair = grid.height_m[:, k], grid.height_m[:, k + 1]
    height = pair[0] if part < 1e-6 else pair[1] if part > 1 - 1e-6 else (1 - part) * pair[0] + part * pair[1]
    holes = np.flatnonzero(np.isnan(height))
    if holes.size:
        raise RouteError(f"row {holes[0] + 1}: nothing was measured at v = {v_m:g} m")
    return height


def _binary(content: bytes, header: Header, columns: NDArray[np.int64]) -> Array:
    kind = np.dtype(BINARY[header.layout])
    channels = len(header.channels)
    row = channels * kind.itemsize
    have = len(content) - header.data_at
    promised = promised_rows(header)
    rows = max(2, have // row) if promised is None else promised
    if have < rows * row:
        raise RouteError(
            f"byte {len(content)}: the file ends here, {rows * row - have} bytes short of {rows} rows of "
            f"{channels} channels from byte {header.data_at}"
        )
    if promised is not None and have - rows * row >= 2 * RECORD_BYTES:
        raise RouteError(
            f"byte {header.data_at + rows * row}: {have - rows * row} bytes more than {rows} rows take"
        )
    raw = np.frombuffer(content, kind, rows * channels, header.data_at).reshape(rows, channels)
    with np.errstate(invalid="ignore"):  # a signalling NaN is a NaN
        table = raw.astype(np.float64)
    if promised is None:  # rows without a single number, at the end, are the padding
        full = np.flatnonzero(~np.all(np.isnan(table), axis=1))
        table = table[: full[-1] + 1 if len(full) else 0]
        if len(table) < 2:
            raise RouteError(f"byte {header.data_at}: {len(table)} rows of numbers; a road takes two")
    height = table[:, columns]
    bad = ~(np.isnan(height) | (np.abs(height) <= HIGHEST_M))
    if bad.any():
        k, column = divmod(int(np.argmax(bad)), len(columns))
        place = header.data_at + k * row + int(columns[column]) * kind.itemsize
        raise RouteError(f"byte {place}: {height[k, column]:g} is no height on earth, in metres")
    return table


def _text(content: bytes, header: Header, columns: NDArray[np.int64]) -> Array:
    """Numbers of fixed width: every row begins a line, and goes on in the next after 80 characters."""
    wide = TEXT[header.layout]
    channels = len(header.channels)
    heights = set(columns.tolist())
    values = array("d")
    file = io.BytesIO(content.rstrip())
    file.seek(header.data_at)
    at = 0  # channel with which the next line begins
    for line_number, raw in enumerate(file, header.line + 1):
        text = raw[: RECORD_BYTES + 1].decode("latin-1").rstrip()
        here = range(at, min(at + RECORD_BYTES // wide, channels))
        if len(text) > len(here) * wide:
            raise RouteError(f"line {line_number}: more than {len(here)} numbers of {wide} characters")
        for column in here:
            word = text[(column - at) * wide :][:wide].strip()
            where = f"line {line_number}: {header.channels[column].name[:40]}"
            value = np.nan if word.startswith("*") else number(word, where)
            if column in heights and abs(value) > HIGHEST_M:
                raise RouteError(f"{where} is {value:g}, no height on earth, in metres")
            values.append(value)
        at = (here[-1] + 1) % channels
    rows = len(values) // channels
    promised = promised_rows(header)
    if at or rows < 2 or (promised is not None and rows != promised):
        wanted = "at least 2" if promised is None else str(promised)
        raise RouteError(
            f"line {line_number if values else header.line}: the file ends after {len(values)} numbers; "
            f"{wanted} rows of {channels} were to come"
        )
    return np.array(values).reshape(rows, channels)


def _modified(header: Header, step: float, v: Array, height: Array, table: Array) -> Grid:
    """Fill what was not measured, scale, and add the reference line's own slope and banking."""
    # Without a section of modifiers the last valid value goes on to the border; an empty one keeps the NaNs.
    given = header.modifiers
    mode = _NEIGHBOUR if given is None else given.get("grid_nan_mode", _KEEP)
    modifiers = given or {}
    height = _filled(height, mode, modifiers.get("grid_nan_offset", 0.0))
    height = height * (modifiers.get("scale_z_grid", 1.0) or 1.0)  # zero is ignored
    names = [channel.name for channel in header.channels]

    def course(name: str, constant: str, scale: str) -> Array:
        if name in names:
            values = table[:, names.index(name)]
            values = np.where(np.isnan(values), 0.0, values)  # **unused**
        else:
            values = np.full(len(height), header.road.get(constant, 0.0))
        values = values * modifiers.get(scale, 1.0)
        steep = np.flatnonzero(~(np.abs(values) <= STEEPEST))
        if steep.size:
            raise RouteError(f"row {steep[0] + 1}: {name} is {values[steep[0]]:g}")
        return values

    slope = course("reference line slope", "reference_line_start_s", "scale_slope")
    slope[0] = 0.0  # a row's slope is that of the step that ends there
    banking = course("reference line banking", "reference_line_start_b", "scale_banking")
    height = height + step * np.cumsum(slope)[:, None] + banking[:, None] * v
    if np.any(np.abs(height) > 2.0 * HIGHEST_M):
        raise RouteError("its modifiers, slope or banking lift it beyond any height on earth")
    length, width = (modifiers.get(key, 1.0) for key in ("scale_length", "scale_width"))
    if not (1e-3 <= length <= 1e3 and 1e-3 <= width <= 1e3):
        raise RouteError(f"scale_length {length:g} or scale_width {width:g} is not from 0.001 to 1000")
    return Grid(step * length, v * width, height)


def _filled(height: Array, mode: float, offset: float) -> Array:
    """Heights with holes filled: with zero, or with the last valid value to the right, else left."""
    hole = np.isnan(height)
    if mode == _ZERO:
        return np.where(hole, offset, height)
    if mode != _NEIGHBOUR or not hole.any():
        return height
    rows, columns = np.arange(height.shape[0])[:, None], np.arange(height.shape[1])
    for direction in (1, -1):
        turned = height[:, ::direction]
        last = np.maximum.accumulate(np.where(np.isnan(turned), 0, columns), axis=1)
        height = turned[rows, last][:, ::direction]
    return np.where(hole, height + offset, height)
