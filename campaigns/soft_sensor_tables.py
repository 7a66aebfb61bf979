"""Soft sensors in figures and tables: chapter III's, ours beside the thesis's.

Belongs here: what is printed and drawn. Never: how a figure is measured.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from bench.printable import printable
from campaigns.narx import Cell, Measured
from campaigns.narx_plan import NarxGrid
from campaigns.soft_sensor import WASHOUT, Predictor, pairs, performance
from campaigns.thesis import thesis
from targets.narx import curves, measures
from targets.narx.measures import Performance
from targets.narx.sequences import Sequences

if TYPE_CHECKING:
    from rich.table import Table

WINDOWS_MS = (10, 500)
"""Windows of section III.4's comparison (figure III.16)."""


@dataclass(frozen=True)
class Figures:
    """One predictor on some runs. worst_tenth: window in ms -> least mean deviation of the worst 10 %."""

    performance: Performance
    aoc_percent: float
    worst_tenth: Mapping[int, float]

    def document(self) -> dict[str, Any]:
        """As plain data for JSON."""
        return {
            **asdict(self.performance),
            "aoc_percent": self.aoc_percent,
            "soe_10_percent": {f"{ms} ms": value for ms, value in self.worst_tenth.items()},
        }


def figures(predictors: Sequence[Predictor], data: Sequences) -> dict[str, Figures]:
    """Every predictor's figures by its name; skill against the half-car where there is one."""
    reference = next((p for p in predictors if p.name.startswith("half-car, fitted")), None)
    found = {}
    for predictor in predictors:
        errors = measures.deviations(pairs(predictor, data), WASHOUT)
        worst = {
            ms: curves.least_of_worst(errors, max(1, round(ms * data.rate_hz / 1000.0))) for ms in WINDOWS_MS
        }
        found[predictor.name] = Figures(performance(predictor, data, reference), curves.aoc(errors), worst)
    return found


def performance_table(
    rows: Mapping[str, Figures], title: str, published: Mapping[str, Mapping[str, float]] | None = None
) -> "Table":
    """Chapter III's figures, a row each predictor; published: row name -> figure -> percent of the thesis."""
    from rich.table import Table

    table = Table(
        title=f"{title}: Er (III.2) and what the worst tenth err at least in a window (III.4), %; RMSE, mm; "
        "skill against the best constant and the fitted half-car",
        title_justify="left",
        box=None,
        pad_edge=False,
    )
    heads = ("", "Er", "worst lap", "worst s", "RMSE", "skill", "")
    for name in (*heads, *(f"{ms} ms" for ms in WINDOWS_MS)):
        table.add_column(name, justify="right" if table.columns else "left", no_wrap=True)
    for name, row in rows.items():
        p = row.performance
        other = "-" if p.skill_of_reference is None else f"{p.skill_of_reference:.2f}"
        table.add_row(
            name,
            f"{p.er_percent:.2f}",
            f"{max(p.run_er_percent):.2f}",
            f"{p.worst_second_percent:.1f}",
            f"{p.rmse:.2f}",
            f"{p.skill:.2f}",
            other,
            *(f"{value:.1f}" for value in row.worst_tenth.values()),
        )
    for name, known in (published or {}).items():
        cells = [f"{known['er']:.0f}" if "er" in known else "-", *["-"] * 5]
        table.add_row(name, *cells, *(f"{known[f'soe_{ms}']:.0f}" for ms in WINDOWS_MS), style="dim")
    return table


def grid_table(plan: NarxGrid, cells: Sequence[Cell]) -> "Table":
    """Table III.2: of each N and d_in how many seeds pass, the best test Er, and the thesis's Yes or No."""
    from rich.table import Table

    published = thesis()["narx_grid"]
    table = Table(
        title=f"Table III.2  Er below {plan.pass_percent:g} % in free run: seeds that pass, "
        f"best Er on the test laps, thesis ({plan.recipe})",
        title_justify="left",
    )
    table.add_column("N", justify="right")
    for d in plan.delays:
        table.add_column(f"d = {d}", justify="right")
    for n in plan.neurons:
        row = [str(n)]
        for d in plan.delays:
            here = [cell for cell in cells if (cell.neurons, cell.delays) == (n, d)]
            passed = [cell for cell in here if cell.passes(plan.pass_percent)]
            best = f"{min(cell.test_percent for cell in passed):.1f} %" if passed else "-"
            row.append(f"{len(passed)}/{len(here)}  {best}  {_published(published, n, d)}")
        table.add_row(*row)
    return table


def _published(grid: Mapping[str, Any], n: int, d: int) -> str:
    if n not in grid["N"] or d not in grid["d_in"]:
        return "-"
    return "Yes" if grid["passes"][grid["N"].index(n)][grid["d_in"].index(d)] else "No"


def chapter_iii() -> dict[str, dict[str, float]]:
    """What the thesis reads off figures III.13 and III.16, as `performance_table` takes it."""
    chosen = thesis()["narx_grid"]["chosen"]
    own, car = chosen["SOE_worst10_percent"], chosen["half_car_SOE_worst10_percent"]
    return {
        "thesis: NARX": {
            "er": chosen["Er_percent"],
            "soe_10": own["L_10ms"],
            "soe_500": own["L_500ms"],
        },
        "thesis: half-car": {"soe_10": car["L_10ms"], "soe_500": car["L_500ms"]},
    }


def each_run_table(measured: Measured) -> "Table":
    """RMSE of every predictor on every run."""
    from rich.markup import escape
    from rich.table import Table

    table = Table(title="RMSE of each ride left out, mm", title_justify="left")
    table.add_column("ride")
    for predictor in measured.predictors:
        table.add_column(predictor.name, justify="right")
    for k, source in enumerate(measured.sources):
        y = measured.data.runs[k][1][WASHOUT:]
        cells = [
            f"{measures.rmse(predictor.predictions[k][WASHOUT:], y):.2f}" for predictor in measured.predictors
        ]
        table.add_row(escape(printable(source)), *cells)
    return table
