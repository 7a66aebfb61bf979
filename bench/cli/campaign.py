"""`bench campaign`: the published tables, ours beside them.

Belongs here: options, progress, files. Never: what is run, how a table is made.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bench.cli.options import Map, Model, Repair, SensorsName

if TYPE_CHECKING:
    from campaigns.narx import Measured
    from campaigns.narx_plan import NarxGrid, NarxLeaveOneOut, NarxPerformance

app = typer.Typer(
    help="The literature's tables, ours beside them.", no_args_is_help=True, pretty_exceptions_enable=False
)


@app.command("list")
def list_() -> None:
    """List the campaigns that come with the bench."""
    from rich.console import Console
    from rich.table import Table

    from campaigns.plan import NAMES, load

    table = Table(box=None, show_header=False, pad_edge=False)
    for name in NAMES:
        plan = load(name)
        table.add_row(name, f"{plan.title}: {plan.stands_for}")
    Console().print(table)


@app.command()
def run(
    name: Annotated[str, typer.Argument(metavar="NAME|FILE", help="A campaign's name, or its .toml file.")],
    laps: Annotated[
        Path | None, typer.Option("--laps", metavar="DIR", help="Laps of your own instead of simulated ones.")
    ] = None,
    model: Model = None,
    sensors: SensorsName = "datasheet",
    map_file: Map = None,
    repair: Repair = False,
    workers: Annotated[int | None, typer.Option(help="Processes.  [default: all cores]")] = None,
    store: Annotated[
        Path | None,
        typer.Option("--store", metavar="FILE", help="Keeps what is finished; the next run goes on from it."),
    ] = None,
    json_out: Annotated[
        Path | None, typer.Option("--json", metavar="OUT", help="Write the results as JSON.")
    ] = None,
    html_out: Annotated[
        Path | None, typer.Option("--html", metavar="OUT", help="Write a page with the curves.")
    ] = None,
) -> None:
    """Run a campaign and print its tables beside the published ones."""
    import os

    from bench.cli.demo import road
    from bench.errors import BenchError
    from bench.whole import check_writable, whole
    from campaigns.errors import CampaignError
    from campaigns.narx_plan import NarxGrid, NarxLeaveOneOut, NarxPerformance
    from campaigns.plan import Campaign, load

    if workers is not None and workers < 1:
        raise BenchError(f"--workers is {workers}; it must be at least 1")
    for out in (json_out, html_out, store):
        if out:
            check_writable(out)
    plan = load(name)
    count = workers or os.cpu_count() or 1
    result: Any = None
    if isinstance(plan, Campaign):
        if laps or model or html_out or store or json_out:
            raise CampaignError(f"{name}: takes none of --laps, --model, --html, --store and --json yet")
        road(plan, workers)
        return
    if html_out:
        from bench.cli.page import check_target

        check_target(html_out, ())
    if isinstance(plan, NarxGrid):
        result = _grid(plan, count, store)
    elif isinstance(plan, NarxPerformance):
        result = _performance(plan, laps, model, map_file, repair, html_out)
    elif isinstance(plan, NarxLeaveOneOut):
        if laps is None:
            raise CampaignError(f"{name}: needs --laps DIR, a folder of recorded rides")
        result = _leave_one_out(plan, laps, sensors, map_file, repair, count, html_out)
    if json_out:
        with whole(json_out) as part:
            part.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")


def _grid(plan: NarxGrid, workers: int, store: Path | None) -> Any:
    from dataclasses import asdict

    from rich.console import Console

    from bench.whole import whole
    from campaigns.narx import Cell, cells, grid
    from campaigns.soft_sensor_tables import grid_table

    key = plan.model_dump_json()
    done: dict[tuple[int, int, int], Cell] = {}
    if store and store.exists():
        done = _stored(store, key)
    wanted = [cell for cell in cells(plan) if cell not in done]

    def keep(cell: Cell) -> None:
        done[cell.neurons, cell.delays, cell.seed] = cell
        if store:
            with whole(store) as part:
                rows = [asdict(row) for row in done.values()]
                part.write_text(json.dumps({"of": key, "cells": rows}, indent=1), encoding="utf-8")

    if wanted:
        with _bar("training", len(wanted)) as advance:
            for cell in grid(plan, wanted, workers, keep):
                advance(f"N = {cell.neurons}, d = {cell.delays}, seed {cell.seed}")
    found = [done[cell] for cell in cells(plan)]
    console = Console()
    console.print(f"[bold]{plan.title}[/]: {plan.stands_for}", highlight=False)
    console.print(grid_table(plan, found), highlight=False)
    return [asdict(cell) for cell in found]


def _stored(store: Path, key: str) -> dict[tuple[int, int, int], Any]:
    from campaigns.errors import CampaignError
    from campaigns.narx import Cell

    try:
        table = json.loads(store.read_text(encoding="utf-8"))
        if table["of"] != key:
            raise CampaignError(f"{store}: holds the results of another campaign")
        found = [Cell(**row) for row in table["cells"]]
    except (ValueError, KeyError, TypeError):
        raise CampaignError(f"{store}: holds no results of a campaign") from None
    return {(cell.neurons, cell.delays, cell.seed): cell for cell in found}


def _performance(
    plan: NarxPerformance,
    laps: Path | None,
    model: Path | None,
    map_file: Path | None,
    repair: bool,
    html_out: Path | None,
) -> Any:
    from rich.console import Console

    from bench.cli.train import laps_in
    from campaigns.narx import performance
    from campaigns.soft_sensor_tables import chapter_iii, figures, performance_table
    from targets.calibration import load
    from targets.ecus import DEFAULT_CALIBRATION

    narx = load(model or DEFAULT_CALIBRATION).network
    test = laps_in(laps, map_file, repair) if laps else None
    with _bar("", None) as advance:
        measured = performance(plan, narx, test, advance)
    rows = figures(measured.predictors, measured.data)
    console = Console()
    console.print(f"[bold]{plan.title}[/]: {plan.stands_for}", highlight=False)
    title = f"{len(measured.sources)} unseen laps"
    console.print(performance_table(rows, title, chapter_iii()), highlight=False)
    _page(html_out, plan.title, measured, performance_table(rows, title, chapter_iii()))
    return {name: row.document() for name, row in rows.items()}


def _leave_one_out(
    plan: NarxLeaveOneOut,
    laps: Path,
    sensors: str,
    map_file: Path | None,
    repair: bool,
    workers: int,
    html_out: Path | None,
) -> Any:
    from rich.console import Console

    from bench.cli.train import laps_in
    from campaigns.narx import leave_one_out
    from campaigns.soft_sensor_tables import each_run_table, figures, performance_table

    rides = laps_in(laps, map_file, repair)
    with _bar("training", len(rides)) as advance:
        measured = leave_one_out(plan, rides, sensors, workers, advance)
    rows = figures(measured.predictors, measured.data)
    console = Console()
    console.print(f"[bold]{plan.title}[/], inputs {', '.join(measured.data.inputs)}", highlight=False)
    console.print(each_run_table(measured), highlight=False)
    console.print(performance_table(rows, "all rides, each predicted by what it was left out of"))
    _page(html_out, plan.title, measured, each_run_table(measured))
    return {name: row.document() for name, row in rows.items()}


def _bar(what: str, total: int | None) -> Any:
    from bench.cli.progress import counted_progress

    return counted_progress(what, total)


def _page(out: Path | None, title: str, measured: Measured, table: Any) -> None:
    if out is None:
        return
    from bench.cli.page import write_page
    from bench.cli.soft_sensor_page import curves_page

    write_page(out, curves_page(title, measured, table))
