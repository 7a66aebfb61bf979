"""`bench lap show`: what a lap holds, as numbers and as a drawing, in the terminal or as a page.

Belongs here: the command. Never: a measure, a curve or a page; those are in `bench.laps.describe`,
`bench.cli.draw` and `bench.cli.page`.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bench.cli.options import Map, Repair
from bench.errors import LapError

if TYPE_CHECKING:
    from rich.table import Table

    from bench.laps.lap import Lap

Html = Annotated[
    Path | None,
    typer.Option("--html", metavar="OUT", help="Write a page of its own, which needs no network (.html)."),
]
Ascii = Annotated[
    bool, typer.Option("--ascii", help="Draw without braille, as where the output cannot carry it.")
]
HEADS = ("channel", "min", "mean", "max", "rms", "std", "unit")


def show(
    path: Annotated[Path, typer.Argument(metavar="LAP", help="Lap file.")],
    map_file: Map = None,
    repair: Repair = False,
    channel: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Only this channel; may be given more than once."),
    ] = None,
    start: Annotated[
        float | None, typer.Option("--from", metavar="S", help="Only from this second on.")
    ] = None,
    end: Annotated[float | None, typer.Option("--to", metavar="S", help="Only up to this second.")] = None,
    html: Html = None,
    ascii_only: Ascii = False,
) -> None:
    """Print what a lap holds: time base, damage, each channel's statistics, and its course as a drawing."""
    from bench.cli import draw
    from bench.laps.steps import GAP

    if html:
        from bench.cli.page import check_target

        check_target(html, [path])
    lap = _read(path, map_file, repair)
    part = section(lap, start, end, channel)
    rows = statistics(part)
    lines = [*_head(lap), *([] if part is lap else [_head_of_part(part)])]
    if html:
        from bench.cli.page import lap_page, write_page

        write_page(html, lap_page(lap, part, lines, HEADS, rows))

    from rich.console import Console

    console, style = Console(), draw.style_for(ascii_only)
    for line in lines:
        console.print(draw.plain(line), markup=False, highlight=False, soft_wrap=True)
    console.print()
    console.print(_table(rows), highlight=False)
    console.print()
    t_s, step_s = part.t_ns / 1e9, _step_ns(lap) / 1e9
    for line in draw.curves(t_s, part.channels, GAP * step_s, console.width, style):
        console.print(line, markup=False, highlight=False, soft_wrap=True)


def _read(path: Path, map_file: Path | None, repair: bool) -> Lap:
    from bench.laps.channel_map import load_map
    from bench.laps.files import read_lap

    return read_lap(path, load_map(map_file) if map_file else None, repair)


def section(lap: Lap, start: float | None, end: float | None, names: list[str] | None) -> Lap:
    """The part of a lap from `start` to `end` seconds on its clock with the channels `names`; None: all.

    Raises LapError for times that are not in order or leave fewer than two samples, and for unknown channels.
    """
    from bench.laps.lap import Lap

    if start is None and end is None and not names:
        return lap
    low = -math.inf if start is None else start
    high = math.inf if end is None else end
    if not low < high:
        raise LapError(f"--from {low:g} is not before --to {high:g}")
    for name in names or ():
        if name not in lap.channels:
            raise LapError(f"{lap.source}: no channel {name}; it has {', '.join(lap.channels)}")
    inside = (lap.t_ns >= low * 1e9) & (lap.t_ns <= high * 1e9)
    if inside.sum() < 2:
        raise LapError(
            f"{lap.source}: {inside.sum()} samples from {max(low, 0):g} to {high:g} s; the lap goes from "
            f"{lap.t_ns[0] / 1e9:g} to {lap.t_ns[-1] / 1e9:g} s"
        )
    channels = {name: values[inside] for name, values in lap.channels.items() if not names or name in names}
    return Lap(lap.t_ns[inside], channels, lap.source, lap.damage)


def statistics(lap: Lap) -> list[list[str]]:
    """Each channel's name and figures as text, in the order of HEADS."""
    import numpy as np

    from bench.cli.draw import number, unit_of

    rows = []
    with np.errstate(over="ignore", invalid="ignore"):
        for name, values in lap.channels.items():
            figures = (values.min(), values.mean(), values.max(), np.sqrt(np.mean(values**2)), values.std())
            rows.append([name, *(number(float(figure)) for figure in figures), unit_of(name)])
    return rows


def _table(rows: list[list[str]]) -> Table:
    from rich.table import Table

    table = Table(box=None, padding=(0, 1), pad_edge=False)
    for head in HEADS:
        table.add_column(head, justify="left" if head in ("channel", "unit") else "right", no_wrap=True)
    for row in rows:
        table.add_row(*row)
    return table


def _head(lap: Lap) -> list[str]:
    import numpy as np

    steps_ns = np.diff(lap.t_ns)
    widest = int(np.argmax(steps_ns))
    step_ns = _step_ns(lap)
    return [
        f"{lap.source}: {lap.duration_ns / 1e9:g} s, {len(lap.t_ns)} samples, {1e9 / step_ns:g} Hz, largest "
        f"gap {steps_ns[widest] / 1e6:g} ms at {lap.t_ns[widest] / 1e9:g} s, sha256 {lap.digest()[:12]}",
        *(f"damage: {line}" for line in lap.damage),
    ]


def _head_of_part(part: Lap) -> str:
    return f"shown: {part.t_ns[0] / 1e9:g} to {part.t_ns[-1] / 1e9:g} s, {len(part.t_ns)} samples"


def _step_ns(lap: Lap) -> float:
    import numpy as np

    return float(np.median(np.diff(lap.t_ns)))
