"""`bench lap compare`: laps side by side, simulated beside recorded.

Belongs here: the command, its columns and its table. Never: a measure; those are in `bench.laps.describe`.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from bench.cli.lap_show import Ascii, Html
from bench.cli.options import Map, Repair
from bench.errors import LapError

if TYPE_CHECKING:
    from rich.console import Console

    from bench.cli.draw import Style
    from bench.laps.channel_map import ChannelMap
    from bench.laps.describe import Delay, Motion
    from bench.laps.lap import Lap

WIDTH = 12
"""Characters of a column; as many as fit stand side by side, the others below."""


def compare(
    laps: Annotated[
        list[Path], typer.Argument(metavar="LAP...", help="Lap files; the laps of a folder are one column.")
    ],
    map_file: Map = None,
    repair: Repair = False,
    html: Html = None,
    ascii_only: Ascii = False,
) -> None:
    """Put laps side by side: ranges, stroke speeds, spectra, and how long after the front the rear follows.

    Each LAP is a column; a folder's laps are pooled. The map is for the files in which it finds its signals;
    the others are read by their own names.
    """
    from rich.console import Console

    from bench.cli import draw
    from bench.laps.channel_map import load_map

    files = [(path, _files(path)) for path in laps]
    names = [path.name or str(path) for path in laps]
    if html:
        from bench.cli.page import check_target

        check_target(html, [file for _, found in files for file in found])
    channel_map = load_map(map_file) if map_file else None
    columns = [
        _measure(
            name if names.count(name) == 1 else str(path),
            [_open(file, channel_map, repair) for file in found],
        )
        for name, (path, found) in zip(names, files, strict=True)
    ]
    style = draw.style_for(ascii_only)
    rows = table(columns, style)
    heads = ["", *(column.name for column in columns)]
    if html:
        from bench.cli.page import comparison_page, write_page
        from bench.laps.describe import STROKES

        motions = {
            stroke: {column.name: column.motions[stroke] for column in columns if stroke in column.motions}
            for stroke in STROKES
        }
        write_page(html, comparison_page(motions, [lap for c in columns for lap in c.laps], heads, rows))
    _print(Console(), [draw.plain(head) for head in heads], rows)


class Column(NamedTuple):
    """What is compared: one lap, or several pooled. delay: None where a stroke is missing."""

    name: str
    laps: list[Lap]
    rate_hz: float
    motions: dict[str, Motion]
    shaken: dict[str, float]
    delay: Delay | None


def _files(path: Path) -> list[Path]:
    from bench.laps.files import FORMATS

    if not path.is_dir():
        return [path]
    files = sorted(file for file in path.iterdir() if file.suffix.lower() in FORMATS)
    if not files:
        raise LapError(f"{path}: no lap in it ({', '.join(FORMATS)})")
    return files


def _open(path: Path, channel_map: ChannelMap | None, repair: bool) -> Lap:
    """The lap as the map reads it, or by its own names where the map does not fit; its damage on stderr."""
    from bench.laps.files import read_lap

    try:
        lap = read_lap(path, channel_map, repair)
    except LapError as mapped:
        if channel_map is None:
            raise
        try:
            lap = read_lap(path, None, repair)
        except LapError as unmapped:
            if str(mapped) == str(unmapped):
                raise
            raise LapError(f"{mapped}; without the map: {unmapped}") from None
    for line in lap.damage:
        typer.echo(f"bench: lap: {path}: {line}", err=True)
    return lap


def _measure(name: str, laps: list[Lap]) -> Column:
    from bench.laps import describe

    pieces = describe.even_pieces(laps)

    def having(channels: Sequence[str]) -> list[Lap]:
        return [piece for piece in pieces if all(channel in piece.channels for channel in channels)]

    both = having(describe.STROKES)
    return Column(
        name,
        laps,
        describe.rate_hz(pieces[0]),
        {s: describe.motion(having([s]), s) for s in describe.STROKES if having([s])},
        {
            a: describe.range_share(describe.pooled_spectrum(having([a]), a))
            for a in ("acc_front_ms2", "acc_rear_ms2", "acc_body_ms2")
            if having([a])
        },
        describe.pooled_delay(both) if both else None,
    )


def table(columns: Sequence[Column], style: Style) -> list[list[str]]:
    """The rows: a name and a cell for each column, '-' for what a lap lacks; a name alone is a heading."""
    from bench.cli.draw import number
    from bench.laps.describe import STROKES

    rows = [
        ["laps", *(str(len(column.laps)) for column in columns)],
        ["duration s", *(number(sum(lap.duration_ns for lap in c.laps) / 1e9, 1) for c in columns)],
        ["rate Hz", *(f"{column.rate_hz:g}" for column in columns)],
    ]
    for stroke in STROKES:
        motions = [column.motions.get(stroke) for column in columns]
        rows += _part(
            stroke.removesuffix("_mm").replace("_", " "), [m and _motion(m, style) for m in motions]
        )
    rows += _part("1-10 Hz, % of power", [_shaken(column) for column in columns])
    return rows + _part("rear after front", [c.delay and _delay(c.delay) for c in columns])


def _part(head: str, each: Sequence[dict[str, str] | None]) -> list[list[str]]:
    names = dict.fromkeys(name for cells in each for name in cells or ())
    return [[head], *([f"  {name}", *((cells or {}).get(name, "-") for cells in each)] for name in names)]


def _motion(motion: Motion, style: Style) -> dict[str, str]:
    from bench.cli.draw import bar, number
    from bench.laps.describe import BANDS_HZ, CLASSES_MM_S, LIMIT_MM_S, PERCENTILES

    cells = {
        "range mm": f"{number(motion.low_mm, 1)}-{number(motion.high_mm, 1)}",
        "std mm": number(motion.std_mm),
        "resolution mm": f"{motion.resolution_mm:.2g}",
    }
    for percent, speed in zip(PERCENTILES, motion.percentiles, strict=True):
        cells[f"{percent:g} % of speeds mm/s"] = number(speed, 0)
    cells |= {
        "fastest mm/s": number(motion.fastest, 0),
        "99 % compression mm/s": number(motion.compression_p99, 0),
        "99 % rebound mm/s": number(motion.rebound_p99, 0),
        "compression/rebound": number(motion.compression_p99 / motion.rebound_p99),
        f"under {LIMIT_MM_S:g} mm/s %": number(100 * motion.under_limit, 1),
    }
    for (low, high), share in zip(pairwise((*CLASSES_MM_S, None)), motion.classes, strict=True):
        name = f"{low:g}-{high:g} mm/s %" if high else f"over {low:g} mm/s %"
        cells[name] = f"{bar(share, 6, style):<6} {number(100 * share, 1):>5}"
    whole = float(motion.bands.sum())
    for (low, high), power in zip(pairwise(BANDS_HZ), motion.bands, strict=True):
        share = 100 * power / whole if whole > 0 else float("nan")
        cells[f"{low:g}-{high:g} Hz rms mm, %"] = f"{number(power**0.5)} {number(share, 1):>5}"
    cells["speed 1-10 Hz %"] = number(100 * motion.speed_in_range, 1)
    cells["acceleration 1-10 Hz %"] = number(100 * motion.acceleration_in_range, 1)
    return cells


def _shaken(column: Column) -> dict[str, str]:
    from bench.cli.draw import number

    return {channel: number(100 * share, 1) for channel, share in column.shaken.items()}


def _delay(delay: Delay) -> dict[str, str]:
    from bench.cli.draw import number

    low, median, high = (number(1e3 * t, 0) for t in (delay.low_s, delay.median_s, delay.high_s))
    return {
        "delay ms": median,
        "quartiles ms": f"{low}, {high}",
        "windows that count": f"{delay.windows} of {delay.of}",
        "delay x speed m": number(delay.base_m),
    }


def _print(console: Console, heads: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """As many columns side by side as the width holds, then the next below them."""
    from rich.table import Table
    from rich.text import Text

    first = max(len(row[0]) for row in rows if len(row) > 1)
    beside = max(1, (console.width - first) // (WIDTH + 1))
    for start in range(1, len(heads), beside):
        shown = Table(box=None, padding=(0, 1, 0, 0), pad_edge=False)
        shown.add_column(min_width=first, no_wrap=True)
        for head in heads[start : start + beside]:
            shown.add_column(Text(head), justify="right", width=WIDTH, overflow="fold")
        for name, *cells in rows:
            shown.add_row(name, *cells[start - 1 : start - 1 + beside], style=None if cells else "bold")
        if start > 1:
            console.print()
        console.print(shown, highlight=False)
