"""The monitor's screen: one look at the bus as lines that fit a terminal of a given size. Pure.

Nothing from outside is read as markup or reaches the terminal unescaped, whatever a DBC holds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from rich.console import Group
from rich.table import Table
from rich.text import Text

from bench.cli import monitor_text as words
from bench.cli.draw import ASCII, Style, bar, number
from bench.printable import printable

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from bench.monitor.rows import EcuRow, Look, MessageRow, SignalRow

STALE_NS = 1_000_000_000
"""A message so old is shown dimmed: what it said is no longer so."""

_BLOCKS, _MARKS = "▁▂▃▄▅▆▇█", "_.-=+*#"
_NAME, _NUMBER, _UNIT = 16, 8, 6
_NARROW, _WIDE, _TALL = 50, 100, 30


@dataclass(frozen=True)
class Frame:
    """What stands around the look.

    title: the bus. keys: key -> fault. note: what came of the last key. recording: its file, if any.
    """

    title: str
    keys: Mapping[str, str]
    note: str = ""
    recording: str = ""
    paused: bool = False


def sparkline(means: NDArray[np.float64], width: int, style: Style) -> str:
    """The values (samples,), NaN where there are none, in `width` characters from lowest to highest."""
    marks = _MARKS if style == ASCII else _BLOCKS
    edges = np.linspace(0, len(means), width + 1).astype(int)
    parts = [means[a:b][~np.isnan(means[a:b])] for a, b in pairwise(edges)]
    columns = np.array([part.mean() if len(part) else math.nan for part in parts])
    there = columns[~np.isnan(columns)]
    if not len(there):
        return " " * width
    low, high = float(there.min()), float(there.max())
    if high - low <= 1e-9 * max(abs(low), abs(high)):
        levels = np.full(width, len(marks) // 2)
    else:
        shares = (np.nan_to_num(columns, nan=low) - low) / (high - low)
        levels = np.rint(shares * (len(marks) - 1)).astype(int)
    return "".join(" " if math.isnan(c) else marks[k] for c, k in zip(columns, levels, strict=True))


def screen(look: Look, frame: Frame, width: int, height: int, style: Style) -> Group:
    """The whole screen: at most `height` lines of at most `width` characters."""
    page = _Page(max(width, 1), style)
    top = [page.line(_head(look, frame), "reverse" if frame.paused else "bold")]
    bottom = [page.line(f"! {text}", "red") for text in look.complaints[:2]]
    if frame.note:
        bottom.append(page.line(frame.note, "yellow"))
    bottom += [page.line(text, "dim") for text in _keys(frame, width, 3 if height >= _TALL else 1)]
    middle = [line for ecu in look.ecus for line in page.ecu(ecu)]
    if look.faults:
        middle.append(page.line(_faults(look), "magenta"))
    room = height - len(top) - len(bottom) - len(middle)
    signals, messages = _shares(room, len(look.signals), len(look.messages))
    tables: list[Text | Table] = []
    if signals:
        tables += page.signals(look.signals, signals)
    if messages:
        tables += page.messages(look.messages, messages)
    if not look.frames and room > 0:
        tables = [page.line("nothing heard yet", "dim")]
    room = max(height, 1) - len(bottom)
    if room < 1 + len(middle):  # so low a terminal shows what matters most
        return Group(*[*top, *middle, *bottom][: max(height, 1)])
    return Group(*top, *tables, *middle, *bottom)


def _shares(room: int, signals: int, messages: int) -> tuple[int, int]:
    """Lines for the two tables, a head line each; 0 for one that finds no room."""
    wanted = [rows + 1 if rows else 0 for rows in (signals, messages)]
    lower = min(wanted[1], max(room - wanted[0], room // 3))
    given = [min(wanted[0], room - max(lower, 0)), lower]
    one, two = (lines if lines >= 2 else 0 for lines in given)
    return one, two


def _head(look: Look, frame: Frame) -> str:
    parts = [frame.title, f"{look.t_ns / 1e9:.1f} s", f"{look.frames} frames", f"{look.per_s:.0f}/s"]
    parts.append(f"bus {words.percent(look.load)}")
    parts.append(f"lost {look.lost}  repeats {look.repeats}")
    if look.unknown:
        parts.append(f"unknown {look.unknown}")
    if look.dropped:
        parts.append(f"dropped {look.dropped}")
    if frame.recording:
        parts.append(f"REC {frame.recording}")
    return "  ".join(["PAUSED", *parts] if frame.paused else parts)


def _keys(frame: Frame, width: int, most: int) -> list[str]:
    """What the keys do, in at most `most` lines."""
    lines = ["q quit  " + ("space go on" if frame.paused else "space pause") + "  c clear"]
    for key, spec in frame.keys.items():
        more = f"{key} {spec}"
        if len(lines) < most and len(lines[-1]) + 2 + len(more) > width:
            lines.append(more)
        else:
            lines[-1] += f"  {more}"
    return lines


def _faults(look: Look) -> str:
    shown = (f"{fault.number} {fault.spec} {fault.state}" for fault in reversed(look.faults))
    return "faults: " + "; ".join(shown)


class _Page:
    """Lines and tables of one width and style."""

    def __init__(self, width: int, style: Style) -> None:
        self._width, self._style = width, style

    def line(self, text: str, how: str = "") -> Text:
        """One line, cut where the terminal ends."""
        shown = Text(self._plain(text), style=how, no_wrap=True, overflow="crop", end="\n")
        shown.truncate(self._width)
        return shown

    def ecu(self, ecu: EcuRow) -> list[Text]:
        """Its alarm and residual, its prediction, its step."""
        red = "bold red" if ecu.alarm else "green"
        step = (
            f"step {words.ms(ecu.step_s)} (worst {words.ms(ecu.worst_step_s)})  "
            f"CPU {words.percent(ecu.load)}  missed {ecu.missed_inputs}  overruns {ecu.overruns}"
        )
        if ecu.residual_pct is None or math.isnan(ecu.residual_pct):
            return [self.line(f"{ecu.role}  {step}")]
        level = words.residual(ecu)
        if ecu.threshold_pct:
            share = min(ecu.residual_pct / (2 * ecu.threshold_pct), 1.0)
            drawn = bar(share, 20, self._style).ljust(20, " " if self._style == ASCII else "░")
            level += f"  {drawn[:10]}|{drawn[10:]}"
        return [
            self.line(f"{ecu.role}  {words.alarm(ecu)}", red),
            self.line(f"  {level}", "red" if _beyond(ecu) else ""),
            self.line(f"  {step}"),
        ]

    def signals(self, rows: Sequence[SignalRow], lines: int) -> list[Text | Table]:
        """`lines` lines: a head, a signal each, and how many are not shown."""
        wide, narrow = self._width >= _WIDE, self._width < _NARROW
        name = min(_NAME + (14 if wide else 0), max(self._width // 3, 4))
        columns = [name, _NUMBER] if narrow else [name, _NUMBER, _UNIT, _NUMBER, _NUMBER]
        heads = ["signal", "value"] if narrow else ["signal", "value", "", "low", "high"]
        spark = self._width - sum(columns) - len(columns) - 1  # a space behind each
        if spark >= 4:
            columns.append(spark)
            heads.append("20 s")
        table = self._table(columns, heads, left=(0, 2, 5))
        for row in rows[: _fitting(len(rows), lines)]:
            title = f"{row.message}.{row.name}" if wide else row.name
            cells = [title, number(row.value)]
            if not narrow:
                cells += [row.unit, number(row.low), number(row.high)]
            if spark >= 4:
                cells.append(sparkline(row.means, spark, self._style))
            self._row(table, cells, row.age_ns)
        return self._with_rest(table, len(rows), lines, "signals")

    def messages(self, rows: Sequence[MessageRow], lines: int) -> list[Text | Table]:
        """`lines` lines: a head, a message each, and how many are not shown."""
        heads = ["message", "id", "frames", "per s", "due", "lost", "repeats", "restarts"]
        widths = [_NAME, 10, 9, 8, 7, 6, 8, 9]
        # narrow terminals lose the columns that say least
        for least in (4, 1, 7, 2, 6, 3, 5):
            if sum(widths) + len(widths) <= self._width:
                break
            widths[least] = 0
        kept = [k for k, width in enumerate(widths) if width]
        table = self._table([min(widths[k], self._width) for k in kept], [heads[k] for k in kept], left=(0,))
        for row in rows[: _fitting(len(rows), lines)]:
            cells = [
                row.name,
                f"{row.id:#x}",
                str(row.frames),
                f"{row.per_s:.1f}",
                words.of(row.due_per_s, "g"),
                *(words.of(count, "d") for count in (row.lost, row.repeats, row.restarts)),
            ]
            self._row(table, [cells[k] for k in kept], row.age_ns, bool(row.lost or row.repeats or row.wrong))
        return self._with_rest(table, len(rows), lines, "messages")

    def _table(self, widths: list[int], heads: list[str], left: tuple[int, ...]) -> Table:
        table = Table(box=None, padding=(0, 1, 0, 0), show_edge=False, show_header=False)
        for k, width in enumerate(widths):
            justify = "left" if k in left else "right"
            table.add_column(width=width, no_wrap=True, overflow="crop", justify=justify)  # type: ignore[arg-type]
        table.add_row(*(self._cell(head, "dim") for head in heads))
        return table

    def _row(self, table: Table, cells: list[str], age_ns: int, wrong: bool = False) -> None:
        style = "dim" if age_ns >= STALE_NS else "yellow" if wrong else ""
        table.add_row(*(self._cell(cell, style) for cell in cells))

    def _with_rest(self, table: Table, rows: int, lines: int, what: str) -> list[Text | Table]:
        hidden = rows - _fitting(rows, lines)
        return [table, self.line(f"... {hidden} more {what}", "dim")] if hidden else [table]

    def _cell(self, text: str, style: str) -> Text:
        return Text(self._plain(text), style=style, no_wrap=True, overflow="crop")

    def _plain(self, text: str) -> str:
        shown = printable(text)
        if self._style == ASCII:
            return shown.encode("ascii", "backslashreplace").decode()
        return shown


def _fitting(rows: int, lines: int) -> int:
    """How many rows are shown in `lines` lines, of which one is the head's."""
    return rows if rows <= lines - 1 else max(lines - 2, 0)


def _beyond(ecu: EcuRow) -> bool:
    return bool(ecu.threshold_pct and ecu.residual_pct and ecu.residual_pct > ecu.threshold_pct)
