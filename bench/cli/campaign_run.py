"""Running a stored campaign and reporting on it: store, executor, progress, files.

Belongs here: what `bench campaign run`, `resume` and `report` share. Never: options' words, a figure.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bench.errors import BenchError

if TYPE_CHECKING:
    from bench.cli.options import Laps
    from campaigns.kinds import Stored, StoredPlan
    from campaigns.runner import Executor, Ran
    from campaigns.store import Store


WIDE = 120
"""Columns of a report in a file or a pipe."""


@dataclass(frozen=True)
class Outputs:
    """The files a report is written to, None for those not asked for; ftti_s: print the margin to it."""

    json: Path | None = None
    html: Path | None = None
    csv: Path | None = None
    parquet: Path | None = None
    junit: Path | None = None
    ftti_s: float | None = None

    def check(self, *stores: Path) -> None:
        """Refuse before any work what could not be written after it, and what would overwrite `stores`."""
        from bench.whole import check_writable
        from campaigns.errors import CampaignError

        if self.ftti_s is not None and not 0 < self.ftti_s < math.inf:
            raise BenchError(f"--ftti is {self.ftti_s:g}; it must be more than 0")
        for path in (self.json, self.csv, self.parquet, self.junit):
            if path:
                check_writable(path)
        if self.html:
            from bench.cli.page import check_target

            check_target(self.html, ())
        for path in (self.json, self.html, self.csv, self.parquet, self.junit):
            if path and path.resolve() in [store.resolve() for store in stores]:
                raise CampaignError(f"{path}: is the store itself")


def processes(workers: int | None) -> int:
    """How many processes --workers asks for: where it is left out, one for each core."""
    return workers or os.cpu_count() or 1


def executor(workers: int | None, cluster: str | None) -> Executor:
    """Where trials run."""
    if workers is not None and workers < 1:
        raise BenchError(f"--workers is {workers}; it must be at least 1")
    if cluster:
        from campaigns.cluster import Cluster

        return Cluster(cluster)
    from campaigns.runner import Local

    return Local(processes(workers))


def prepared(
    name: str, plan: StoredPlan, model: str | None, host: str, laps: Laps | None, workers: int | None
) -> Stored:
    """The campaign's trials, with the ECU and the laps asked for."""
    from dataclasses import replace

    from bench.cli.progress import counted_progress
    from campaigns import kinds
    from campaigns.narx_plan import NarxGrid
    from campaigns.road_plan import RoadPlan
    from targets.ecus import build, calibration_of

    if isinstance(plan, NarxGrid):
        with counted_progress("riding", None):
            return kinds.grid(name, plan)
    chosen = model or plan.model
    if isinstance(plan, RoadPlan):
        ecu = build("ifd", host)
        if chosen:
            ecu = replace(ecu, calibration=calibration_of(chosen))
        files = [kinds.lap_file(path, lap) for path, lap in laps.each()] if laps else []
        where = vars(laps) if laps else {}
        return kinds.road(name, plan, ecu, files, where)
    calibration = calibration_of(chosen) if chosen else build().calibration
    ridden = laps.read() if laps else None
    count = len(ridden) if ridden is not None else plan.test.count
    with counted_progress("predicting", count) as advance:
        return kinds.offline(name, plan, calibration, ridden, processes(workers), advance)


def carry_out(ready: Stored, store: Store, where: Executor, fail_fast: bool) -> Ran:
    """Run what the store lacks, with a bar of how many, how fast and how long yet."""
    from bench.cli.progress import counted_progress, trials_progress
    from campaigns.runner import run

    missing = {job.id for job in ready.jobs} - store.ids()
    if missing:
        with counted_progress("compiling, once", None):
            ready.warm_up()
    with trials_progress(len({job.id for job in ready.jobs})) as tell:
        return run(ready.jobs, ready.work, store, where, tell, fail_fast)


def report(store: Store, outputs: Outputs) -> None:
    """Print a store's tables and write the files asked for."""
    from functools import partial

    from rich.markup import escape

    from bench.cli.campaign_page import campaign_page
    from bench.cli.page import write_page
    from campaigns import export, kinds
    from campaigns.errors import CampaignError
    from campaigns.junit import write_junit
    from campaigns.reading import frame_of, plan_of, rows_of
    from campaigns.road_plan import FAULT_FREE, RoadPlan
    from campaigns.thesis import published_road

    plan = plan_of(store)
    rows = rows_of(store, plan)
    road = isinstance(plan, RoadPlan)
    if outputs.junit and not road:
        raise CampaignError(f"{store.path}: --junit is for road trials")
    tables = kinds.tables(plan, rows, outputs.ftti_s)
    # an offline campaign's thousands of trials are in its store, its tables hold what they come to
    document = export.document(store.campaign, tables, rows if road else [])
    page = ""
    if outputs.html:
        frame, published = (partial(frame_of, store), published_road()) if road else (None, None)
        page = campaign_page(document, frame, published, *kinds.page_parts(plan, tables))
    console = wide_console()
    console.print(f"[bold]{escape(plan.title)}[/]: {escape(plan.stands_for)}", highlight=False)
    console.print(about(store.campaign, rows), highlight=False, markup=False)
    for part in kinds.shown(plan, tables):
        console.print(part, highlight=False)
        console.print()
    if outputs.csv:
        export.write_csv(outputs.csv, rows)
    if outputs.parquet:
        export.write_parquet(outputs.parquet, rows, store.campaign)
    if outputs.junit and isinstance(plan, RoadPlan):
        write_junit(outputs.junit, store.campaign["name"], rows, [FAULT_FREE, *plan.faults])
    if outputs.json:
        export.write_json(outputs.json, document)
    if outputs.html:
        write_page(outputs.html, page)


def wide_console() -> Any:
    """The output; where it is no terminal, as wide as the offline campaign's tables."""
    from rich.console import Console

    console = Console()
    return console if console.is_terminal or "COLUMNS" in os.environ else Console(width=WIDE)


def compare(after: Store, before: Store, outputs: Outputs, tolerance_s: float | None = None) -> None:
    """Print which verdicts of `after` differ from those of `before`, and write the files asked for."""
    from functools import partial

    from bench.cli.campaign_page import difference_page
    from bench.cli.page import write_page
    from campaigns import export
    from campaigns.differences import TOLERANCE_S, difference_tables, differences
    from campaigns.errors import CampaignError
    from campaigns.reading import frame_of, plan_of, rows_of

    names = before.path.name, after.path.name
    first, second = (rows_of(store, plan_of(store)) for store in (before, after))
    found = differences(first, second, TOLERANCE_S if tolerance_s is None else tolerance_s)
    if not found["matched"]:
        raise CampaignError(f"{after.path}: has no trial in common with {before.path}, whatever their ECUs")
    page = ""
    if outputs.html:
        before_by_id, after_by_id = ({row.id: row for row in rows} for rows in (first, second))
        trials = [
            tuple(
                {"id": row.id, "trial": row.trial, "result": row.result}
                for row in (before_by_id[change["a"]], after_by_id[change["b"]])
            )
            for change in found["changed"]
        ]
        frames = partial(frame_of, before), partial(frame_of, after)
        page = difference_page(found, names, trials, frames, (before.campaign, after.campaign))
    console = wide_console()
    for part in difference_tables(found, *names):
        console.print(part, highlight=False)
    if outputs.json:
        export.write_json(outputs.json, found)
    if outputs.html:
        write_page(outputs.html, page)


def about(campaign: dict[str, Any], rows: Sequence[Any]) -> str:
    """One line: how many trials, of which laps, on which ECU."""
    plan = campaign["plan"]
    route = plan.get("route") or plan["test"]["route"]
    routes = route if isinstance(route, str) else ", ".join(route)
    laps = "laps of one's own" if campaign["laps"] else f"route {routes}"
    ecus = {(one["ecu"], one["runs_on"]) for one in campaign.get("ecu", [])}
    places = {"mcu": "the emulated STM32F405", "host": "the host core"}
    on = "".join(f"; ECU {ecu} on {places[place]}, CAN at 500 kbit/s" for ecu, place in sorted(ecus))
    return f"{len(rows)} trials, {laps}{on}\n"
