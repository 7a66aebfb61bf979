"""The outcome document as tables of cells: the terminal and the page print the same ones.

Belongs here: which figures stand in which column, and how many digits they show. Never: a figure that the
document lacks, HTML.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from campaigns.store import Document

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, RenderableType, RenderResult
    from rich.table import Table

NONE = "-"


class Cell(NamedTuple):
    """What is shown and, of a figure, where it stands in the document (KEY.PATH) and its value there.

    marked: set off from the others, as the thesis's grey regions are.
    """

    text: str
    key: str = ""
    value: Any = None
    marked: bool = False


@dataclass(frozen=True)
class Sheet:
    """A table: its name, the heads of its columns, rows of as many cells, and what has to be said below.

    `spread`: the path of the rate that a drawing shows in each row, if one is shown.
    """

    name: str
    heads: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    note: str = ""
    spread: str = ""


def sheets(tables: Document, published: Mapping[str, Any] | None = None) -> list[Sheet]:
    """The tables of a road campaign, without those that would be empty.

    published: figures to stand beside: by condition CD in percent and TD_s as mean and sigma; steps by code.
    """
    found = [
        _detection(tables["conditions"], published or {}),
        _times(tables["conditions"], published or {}),
        _fault_free(tables["fault_free"]),
        _smallest(tables.get("curves", [])),
        _steps(tables["steps"], published or {}),
    ]
    return [sheet for sheet in found if sheet.rows]


def invalid_lines(tables: Document) -> list[str]:
    """What is printed before any table: how many runs prove nothing, then each with its reason."""
    runs = tables["invalid"]["runs"]
    if not runs:
        return [f"INVALID runs: none of {tables['n']}"]
    lines = [f"INVALID runs: {len(runs)} of {tables['n']}, they enter no rate"]
    return lines + [f"{run['condition']}, {run['lap']} ({run['id']}): {run['reason']}" for run in runs]


def rich_table(sheet: Sheet) -> RenderableType:
    """The table for a terminal: columns that do not fit stand below the others, the rows named again."""
    return _OnTerminal(sheet)


@dataclass(frozen=True)
class _OnTerminal:
    sheet: Sheet

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        from rich.text import Text

        widths = [
            max(
                *(len(word) for word in head.split() or [""]),
                *(len(row[number].text) for row in self.sheet.rows),
            )
            for number, head in enumerate(self.sheet.heads)
        ]
        parts: list[list[int]] = [[]]
        for number in range(1, len(widths)):
            if parts[-1] and widths[0] + sum(widths[k] + 2 for k in (*parts[-1], number)) > options.max_width:
                parts.append([])
            parts[-1].append(number)
        yield Text(self.sheet.name, "bold")
        for place, part in enumerate(parts):
            if place:
                yield ""
            yield self._part([0, *part], widths)
        if self.sheet.note:
            yield Text(self.sheet.note, "dim")

    def _part(self, columns: Sequence[int], widths: Sequence[int]) -> Table:
        from rich.table import Table
        from rich.text import Text

        table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False)
        for k in columns:
            side: Literal["left", "right"] = "right" if k else "left"
            table.add_column(self.sheet.heads[k], justify=side, width=widths[k], vertical="bottom")
        for row in self.sheet.rows:
            table.add_row(*(Text(row[k].text, "reverse" if row[k].marked else "") for k in columns))
        return table


def _detection(groups: Sequence[Document], published: Mapping[str, Any]) -> Sheet:
    heads = ["Condition", "INVALID", "n", "CD", "CD %", "95 % interval", "MD", "FA", "ID", "DC at least, %"]
    naming = any(group["named"]["n"] for group in groups)
    heads += ["kind named", "right %", "right, 95 %"] * naming
    published = published.get("CD", {})
    beside = any(_published(group, published) is not None for group in groups)
    rows = []
    for group in groups:
        row = [_name(group), *(_figure(group, path, str) for path in ("invalid", "n", "CD"))]
        row += [_figure(group, "rates.CD.value", percent), _interval(group, "rates.CD")]
        row += [_figure(group, outcome, str) for outcome in ("MD", "FA", "ID")]
        row += [_figure(group, "coverage", _percent_down)]
        if naming:
            row += [_figure(group, "named.n", str), _figure(group, "named.value", percent)]
            row.append(_interval(group, "named"))
        if beside:
            figure = _published(group, published)
            row.append(Cell(NONE if figure is None else f"{figure:.1f}"))
        rows.append(row)
    note = (
        "CD detected in time, MD missed, FA alarm before the fault, ID wrong sensor or kind. DC: the runs "
        "support a diagnostic coverage of this fault of at least so much at 95 % (Clopper-Pearson)."
    )
    return Sheet(
        "Diagnostic performance (Table V.14)", [*heads, *["thesis CD %"] * beside], rows, note, "rates.CD"
    )


def _times(groups: Sequence[Document], published: Mapping[str, Any]) -> Sheet:
    heads = ["Condition", "detected", "mean", "sigma", "median", "p95", "max", "missed", "median of all"]
    published = published.get("TD_s", {})
    beside = any(_published(group, published) is not None for group in groups)
    tolerant = any(group["ftti"] for group in groups)
    rows = []
    for group in groups:
        row = [_name(group), _figure(group, "td_s.n", str)]
        row += [_figure(group, f"td_s.{path}", seconds) for path in ("mean", "sigma", "median", "p95", "max")]
        row += [_figure(group, "td_s.censored", str), _figure(group, "td_s.median_of_all", seconds)]
        if tolerant:
            row += [_figure(group, f"ftti.{path}", seconds) for path in ("ftti_s", "margin_p95_s")]
            row += [_figure(group, "ftti.margin_max_s", seconds), _figure(group, "ftti.beyond", str)]
        if beside:
            figures = _published(group, published)
            row.append(Cell(NONE if figures is None else ", ".join(f"{figure:.1f}" for figure in figures)))
        rows.append(row)
    heads += ["FTTI", "margin p95", "margin max", "beyond FTTI"] * tolerant
    heads += ["thesis mean, sigma"] * beside
    note = (
        "Of correct detections. Missed faults are censored: counted, but in no mean; the median of all takes "
        "whatever was not detected correctly as infinite."
    )
    return Sheet("Time to detect, s (Table V.15)", heads, rows, note)


def _fault_free(groups: Sequence[Document]) -> Sheet:
    heads = ["Condition", "INVALID", "laps", "hours", "laps with FA", "95 % interval, %", "alarms"]
    rows = [
        [
            _name(group),
            *(_figure(group, path, str) for path in ("invalid", "n")),
            _figure(group, "hours", lambda hours: f"{hours:.2f}"),
            _figure(group, "FA", str),
            _interval(group, "rates.FA"),
            _figure(group, "alarms", str),
            _figure(group, "alarms_per_h_at_most", _up),
        ]
        for group in groups
    ]
    note = "No alarm in T hours bounds their rate by 3/T at 95 %."
    return Sheet("Without a fault", [*heads, "alarms/h at most"], rows, note, "rates.FA")


def _smallest(curves: Sequence[Document]) -> Sheet:
    rows = []
    for curve in curves:
        if curve["smallest"] is None:
            continue
        row = [_name(curve), Cell(str(len(curve["points"])))]
        for side in ("below", "above"):
            row.append(_figure(curve, f"smallest.{side}.magnitude", lambda value: f"{value:g}"))
            row.append(_figure(curve, f"smallest.{side}.distance", lambda value: f"{value:g}"))
        rows.append(row)
    heads = ["Fault", "magnitudes tried", "below", "by", "above", "by"]
    note = "From there on every larger magnitude tried was found in 90 % of its runs or more."
    return Sheet("Smallest magnitude found", heads, rows, note)


def _steps(steps: Sequence[Document], published: Mapping[str, Any]) -> Sheet:
    rows = []
    for each in steps:
        figures = [_figure(each, f"{path}_us", lambda us: f"{us:.1f}") for path in _STEP]
        rows.append([_name(each), _figure(each, "n", str), *figures])
    if rows:
        for name, (mean, sigma) in published.get("steps", {}).items():
            shown = (name, NONE, f"{mean:.1f}", f"{sigma:.1f}", NONE, NONE)
            rows.append([Cell(text) for text in shown])
    note = "Ours by the cycle model of the emulated MCU."
    return Sheet("Execution time of one step, us (Table V.13)", ["ECU", "n", *_STEP], rows, note)


def _published(group: Document, figures: Mapping[str, Any]) -> Any:
    # What a sweep changed was not published.
    return None if group["parameters"] else figures.get(group["condition"])


_STEP = ("mean", "sigma", "min", "max")


def _name(group: Document) -> Cell:
    return Cell(group["key"])


def _figure(group: Document, path: str, show: Callable[[Any], str]) -> Cell:
    value = at(group, path)
    return Cell(NONE if value is None else show(value), f"{group['key']}.{path}", value)


def at(group: Document, path: str) -> Any:
    """What stands at PART.PART in a document, None where a part is none."""
    value: Any = group
    for part in path.split("."):
        value = None if value is None else value[part]
    return value


def _interval(group: Document, path: str) -> Cell:
    low, high = at(group, f"{path}.interval")
    text = NONE if low is None else f"{percent(low)}-{percent(high)}"
    return Cell(text, f"{group['key']}.{path}.interval", [low, high])


def percent(share: float) -> str:
    """A share as percent."""
    return f"{100 * share:.1f}"


def seconds(value: float) -> str:
    """A time in s, to the millisecond: the quickest checks take a few control periods of ten."""
    return f"{value:.3f}"


def _percent_down(share: float) -> str:
    # A lower bound that is rounded up claims too much.
    return f"{math.floor(1000 * share) / 10:.1f}"


def _up(bound: float) -> str:
    return f"{math.ceil(1000 * bound) / 1000:.3f}"
