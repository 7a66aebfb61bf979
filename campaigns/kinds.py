"""What the command line knows of a stored campaign, whatever its kind: jobs, work, tables, and how they are
shown.

Belongs here: one face for road trials and offline campaigns. Never: a file's format, a screen.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bench.laps.lap import Lap
from bench.provenance import versions
from campaigns import narx, offline_score, offline_shown
from campaigns import offline as offline_campaign
from campaigns.export import road_tables
from campaigns.narx_plan import NarxGrid
from campaigns.offline_plan import OfflineCampaign
from campaigns.rivals import compared, compared_sheet, rivals
from campaigns.road import LapFile, expand
from campaigns.road_plan import FAULT_FREE, RoadPlan
from campaigns.runner import Job, Work
from campaigns.sheets import Sheet, invalid_lines, rich_table, sheets
from campaigns.soft_sensor_tables import grid_table
from campaigns.store import Document, Row
from campaigns.thesis import published_road
from targets.calibration import Calibration
from targets.ecus import Build, calibration_of

if TYPE_CHECKING:
    from rich.console import RenderableType

StoredPlan = RoadPlan | OfflineCampaign | NarxGrid


@dataclass(frozen=True)
class Stored:
    """A campaign ready to run: what identifies it, its trials and what carries them out."""

    campaign: Document
    jobs: Sequence[Job]
    work: Work[Any]
    warm_up: Callable[[], None] = field(default=lambda: None)


def road(
    name: str, plan: RoadPlan, build: Build, files: Sequence[LapFile], where: Mapping[str, Any]
) -> Stored:
    """A road trial with `build` in every lap. where: folder, map_file and repair of laps of one's own."""
    trials, work = expand(plan, build, files, **where)
    laps = [file.sha256 for file in files] or None
    campaign = _campaign(name, plan, laps, {"ecu": [one.provenance() for one in work.builds]})

    def warm_up() -> None:
        # what is compiled once, so that forked workers have it and others find it on disk
        from dataclasses import replace

        from campaigns.laps import Simulated

        if trials:
            short = Simulated("mixed_5km", "gsxr1000", 0, 1.0)
            work(replace(trials[0], lap=short, fault=""))

    return Stored(campaign, trials, work, warm_up)


def offline(
    name: str,
    plan: OfflineCampaign,
    calibration: Calibration,
    laps: Sequence[Lap] | None,
    workers: int,
    tell: Callable[[str], None] = lambda _: None,
) -> Stored:
    """The offline campaign; predicts every lap before it returns."""
    others = rivals(calibration)
    if not others and plan.compare:
        # its detectors on this network: where that is another one, they were tuned for other errors
        others = rivals(calibration_of(plan.compare))
    prepared = offline_campaign.prepare(plan, laps, calibration, tell, workers, others)
    digests = [lap.digest() for lap in laps] if laps is not None else None
    model = {"model_sha256": offline_campaign.model_sha256(calibration.network)}
    work = partial(offline_campaign.work, prepared=prepared)
    return Stored(_campaign(name, plan, digests, model), offline_campaign.jobs(prepared), work)


def grid(name: str, plan: NarxGrid) -> Stored:
    """Table III.2; rides its laps before it returns."""
    return Stored(_campaign(name, plan, None, {}), narx.grid_trials(plan), narx.grid_work(plan))


def _campaign(name: str, plan: StoredPlan, laps: Sequence[str] | None, more: Document) -> Document:
    return {
        "name": name,
        "title": plan.title,
        "stands_for": plan.stands_for,
        "conditions": [] if isinstance(plan, NarxGrid) else list(plan.faults),
        "plan": plan.model_dump(mode="json", by_alias=True),
        "laps": laps,
        "versions": versions(),
        **more,
    }


def tables(plan: StoredPlan, rows: Iterable[Row], ftti_s: float | None = None) -> Document:
    """Every figure of a campaign, from its finished trials alone."""
    rows = list(rows)
    if isinstance(plan, RoadPlan):
        return road_tables(rows, [FAULT_FREE, *plan.faults], ftti_s)
    pairs = [(row.trial, row.result) for row in rows]
    if isinstance(plan, NarxGrid):
        return {"cells": [finite_cell(cell) for cell in narx.grid_cells(plan, pairs)]}
    return {**offline_score.score(plan, pairs), "compared": compared(pairs, list(plan.faults), plan.t_max_s)}


def shown(plan: StoredPlan, found: Document) -> "list[RenderableType]":
    """What the terminal prints of the tables: what is invalid first."""
    if isinstance(plan, RoadPlan):
        from rich.markup import escape

        lines = invalid_lines(found)
        style = "bold red" if found["invalid"]["runs"] else ""
        head = "\n".join(escape(line) for line in lines)
        return [f"[{style}]{head}[/]" if style else head, *map(rich_table, sheets(found, published_road()))]
    if isinstance(plan, NarxGrid):
        cells = [narx.Cell(**{key: _or_inf(value) for key, value in cell.items()}) for cell in found["cells"]]
        return [grid_table(plan, cells)]
    beside = [rich_table(compared_sheet(found["compared"]))] if found["compared"] else []
    return [*offline_shown.tables(plan, found), *beside]


def page_parts(plan: StoredPlan, found: Document) -> tuple[list[Sheet], list[Document]]:
    """Tables and curves of a campaign's page beside those that every road trial has."""
    if not isinstance(plan, OfflineCampaign):
        return [], []
    sheets, plots = offline_shown.page_parts(plan, found)
    return ([compared_sheet(found["compared"])] if found["compared"] else []) + sheets, plots


def finite_cell(cell: narx.Cell) -> Document:
    """A network of the grid as a document, null where it diverged."""
    return {key: None if value == math.inf else value for key, value in asdict(cell).items()}


def _or_inf(value: Any) -> Any:
    return math.inf if value is None else value


def lap_file(path: Path, lap: Lap) -> LapFile:
    """What a campaign keeps of a lap of one's own."""
    return LapFile(path.name, lap.digest(), lap.duration_ns / 1e9, tuple(lap.channels))
