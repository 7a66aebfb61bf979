"""Running the campaigns of soft sensors that keep no store: chapter III's figures, leave one out.

Belongs here: progress, files, what is printed. Never: what is run, how a table is made.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from bench.cli.options import Laps
    from campaigns.narx import Measured
    from campaigns.narx_plan import NarxLeaveOneOut, NarxPerformance


def run(
    name: str,
    plan: NarxPerformance | NarxLeaveOneOut,
    laps: Laps | None,
    model: str | None,
    sensors: str | None,
    workers: int,
    html_out: Path | None,
) -> Any:
    """Run either, print its tables and write its page; its figures for --json."""
    from campaigns.errors import CampaignError
    from campaigns.narx_plan import NarxPerformance

    if isinstance(plan, NarxPerformance):
        return performance(plan, laps, model, html_out)
    if laps is None:
        raise CampaignError(f"{name}: needs --laps DIR, a folder of recorded rides")
    return leave_one_out(plan, laps, sensors or "datasheet", workers, html_out)


def performance(plan: NarxPerformance, laps: Laps | None, model: str | None, html_out: Path | None) -> Any:
    """Measure a network on unseen laps beside the half-car sensor, and print section III.4's figures."""
    from rich.console import Console
    from rich.markup import escape

    from bench.cli.progress import counted_progress
    from campaigns.narx import performance as measure
    from campaigns.soft_sensor_tables import chapter_iii, figures, performance_table
    from targets.ecus import DEFAULT_NAME, calibration_of

    narx = calibration_of(model or DEFAULT_NAME).network
    test = laps.read() if laps else None
    with counted_progress("", None) as advance:
        measured = measure(plan, narx, test, advance)
    rows = figures(measured.predictors, measured.data)
    console = Console()
    console.print(f"[bold]{escape(plan.title)}[/]: {escape(plan.stands_for)}", highlight=False)
    title = f"{len(measured.sources)} unseen laps"
    console.print(performance_table(rows, title, chapter_iii()), highlight=False)
    _page(html_out, plan.title, measured, performance_table(rows, title, chapter_iii()))
    return {name: row.document() for name, row in rows.items()}


def leave_one_out(
    plan: NarxLeaveOneOut, laps: Laps, sensors: str, workers: int, html_out: Path | None
) -> Any:
    """Train on all rides but one and predict that one, each in turn, beside a linear filter as long."""
    from rich.console import Console
    from rich.markup import escape

    from bench.cli.progress import counted_progress
    from campaigns.narx import leave_one_out as train_each
    from campaigns.soft_sensor_tables import each_run_table, figures, performance_table

    rides = laps.read()
    with counted_progress("training", len(rides)) as advance:
        measured = train_each(plan, rides, sensors, workers, advance)
    rows = figures(measured.predictors, measured.data)
    console = Console()
    console.print(f"[bold]{escape(plan.title)}[/], inputs {', '.join(measured.data.inputs)}", highlight=False)
    console.print(each_run_table(measured), highlight=False)
    console.print(performance_table(rows, "all rides, each predicted by what it was left out of"))
    _page(html_out, plan.title, measured, each_run_table(measured))
    return {name: row.document() for name, row in rows.items()}


def _page(out: Path | None, title: str, measured: Measured, table: Any) -> None:
    if out is None:
        return
    from bench.cli.page import write_page
    from bench.cli.soft_sensor_page import curves_page

    write_page(out, curves_page(title, measured, table))
