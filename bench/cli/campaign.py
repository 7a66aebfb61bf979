"""`bench campaign`: the published tables, ours beside them.

Belongs here: options, and which campaign goes where. Never: what is run, how a table is made.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bench.cli.options import Host, Map, Repair

if TYPE_CHECKING:
    from bench.cli.campaign_run import Outputs
    from campaigns.plan import Plan

app = typer.Typer(
    help="The literature's tables, ours beside them.", no_args_is_help=True, pretty_exceptions_enable=False
)

Name = Annotated[str, typer.Argument(metavar="NAME|FILE", help="A campaign's name, or its .toml file.")]
LapsFolder = Annotated[
    Path | None, typer.Option("--laps", metavar="DIR", help="Laps of your own instead of simulated ones.")
]
ModelName = Annotated[
    str | None,
    typer.Option("--model", metavar="NAME|FILE", help="Calibration.  [default: the campaign's]"),
]
SensorsOf = Annotated[
    str | None,
    typer.Option("--sensors", metavar="NAME|FILE", help="Instruments.  [default: the campaign's]"),
]
Workers = Annotated[int | None, typer.Option(help="Processes.  [default: all cores]")]
ClusterUrl = Annotated[
    str | None, typer.Option("--cluster", metavar="URL", help="A Dask scheduler, tcp://HOST:PORT.")
]
StoreFile = Annotated[
    Path | None,
    typer.Option("--store", metavar="FILE", help="Keeps what is finished.  [default: NAME.sqlite]"),
]
FailFast = Annotated[
    bool, typer.Option("--fail-fast", help="Begin no further trial after one that fails its verdict.")
]
Ftti = Annotated[
    float | None,
    typer.Option("--ftti", metavar="S", help="Fault tolerant time interval: print the margin to it."),
]
JsonOut = Annotated[
    Path | None, typer.Option("--json", metavar="OUT", help="Write tables and trials as JSON.")
]
HtmlOut = Annotated[Path | None, typer.Option("--html", metavar="OUT", help="Write a page to look at.")]
CsvOut = Annotated[Path | None, typer.Option("--csv", metavar="OUT", help="Write the trials as CSV.")]
ParquetOut = Annotated[
    Path | None, typer.Option("--parquet", metavar="OUT", help="Write the trials as Parquet.")
]
JunitOut = Annotated[Path | None, typer.Option("--junit", metavar="OUT", help="Write verdicts as JUnit XML.")]


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
    name: Name,
    laps: LapsFolder = None,
    model: ModelName = None,
    on: Host = "mcu",
    sensors: SensorsOf = None,
    map_file: Map = None,
    repair: Repair = False,
    workers: Workers = None,
    cluster: ClusterUrl = None,
    store: StoreFile = None,
    fail_fast: FailFast = False,
    ftti: Ftti = None,
    json_out: JsonOut = None,
    html_out: HtmlOut = None,
    csv_out: CsvOut = None,
    parquet_out: ParquetOut = None,
    junit_out: JunitOut = None,
) -> None:
    """Run a campaign and print its tables beside the published ones.

    Every finished trial is kept in the store at once; the same command goes on from there.
    """
    from bench.cli.campaign_run import Outputs

    outputs = Outputs(json_out, html_out, csv_out, parquet_out, junit_out)
    options = (laps, model, on, sensors, map_file, repair, workers, cluster)
    _run(name, *options, store, fail_fast, ftti, outputs, False)


@app.command()
def resume(
    name: Name,
    laps: LapsFolder = None,
    model: ModelName = None,
    on: Host = "mcu",
    sensors: SensorsOf = None,
    map_file: Map = None,
    repair: Repair = False,
    workers: Workers = None,
    cluster: ClusterUrl = None,
    store: StoreFile = None,
    fail_fast: FailFast = False,
    ftti: Ftti = None,
    json_out: JsonOut = None,
    html_out: HtmlOut = None,
    csv_out: CsvOut = None,
    parquet_out: ParquetOut = None,
    junit_out: JunitOut = None,
) -> None:
    """Go on with a campaign that was interrupted: its store must be there; only what is missing is run."""
    from bench.cli.campaign_run import Outputs

    outputs = Outputs(json_out, html_out, csv_out, parquet_out, junit_out)
    options = (laps, model, on, sensors, map_file, repair, workers, cluster)
    _run(name, *options, store, fail_fast, ftti, outputs, True)


@app.command()
def report(
    store: Annotated[Path, typer.Argument(metavar="STORE", help="A campaign's store.")],
    against: Annotated[
        Path | None,
        typer.Option("--against", metavar="STORE", help="Another run: which verdicts changed since then."),
    ] = None,
    ftti: Ftti = None,
    json_out: JsonOut = None,
    html_out: HtmlOut = None,
    csv_out: CsvOut = None,
    parquet_out: ParquetOut = None,
    junit_out: JunitOut = None,
) -> None:
    """Print a store's tables again, finished or not, or what changed against another one."""
    from bench.cli import campaign_run
    from campaigns.errors import CampaignError
    from campaigns.store import Store

    outputs = campaign_run.Outputs(json_out, html_out, csv_out, parquet_out, junit_out)
    outputs.check()
    with Store.read(store) as found:
        if against is None:
            campaign_run.report(found, outputs, ftti)
            return
        if csv_out or parquet_out or junit_out:
            raise CampaignError("--against takes --json and --html alone")
        with Store.read(against) as before:
            campaign_run.compare(found, before, outputs)


def _run(
    name: str,
    laps: Path | None,
    model: str | None,
    on: str,
    sensors: str | None,
    map_file: Path | None,
    repair: bool,
    workers: int | None,
    cluster: str | None,
    store: Path | None,
    fail_fast: bool,
    ftti: float | None,
    outputs: Outputs,
    resuming: bool,
) -> None:
    from bench.cli import campaign_run
    from campaigns.errors import CampaignError
    from campaigns.narx_plan import NarxGrid
    from campaigns.offline_plan import OfflineCampaign
    from campaigns.plan import load
    from campaigns.road_plan import RoadPlan
    from campaigns.store import Store

    where = campaign_run.executor(workers, cluster)
    outputs.check()
    plan = load(name)
    if not isinstance(plan, RoadPlan | OfflineCampaign | NarxGrid):
        if resuming or store or cluster or fail_fast or outputs.csv or outputs.parquet or outputs.junit:
            raise CampaignError(f"{name}: takes --laps, --model, --workers, --json and --html alone")
        _soft_sensor(name, plan, laps, model, sensors, map_file, repair, workers, outputs)
        return
    if isinstance(plan, NarxGrid) and (laps or model or outputs.html):
        raise CampaignError(f"{name}: takes none of --laps, --model and --html")
    if outputs.junit and not isinstance(plan, RoadPlan):
        raise CampaignError(f"{name}: --junit is for road trials: no other campaign judges single runs")
    path = store or Path(f"{Path(name).stem}.sqlite")
    if resuming and not path.exists():
        raise CampaignError(f"{path}: no such store to go on with")
    if sensors:
        plan = plan.model_copy(update={"sensors": sensors})
    own = campaign_run.Laps(laps, map_file, repair) if laps else None
    ready = campaign_run.prepared(Path(name).stem, plan, model, on, own, workers)
    with Store.open(path, ready.campaign) as kept:
        ran = campaign_run.carry_out(ready, kept, where, fail_fast)
        if ran.before:
            typer.echo(f"bench: campaign: {ran.before} of {ran.total} trials were in {path}", err=True)
        campaign_run.report(kept, outputs, ftti)
    if ran.failed:
        typer.echo(
            f"bench: campaign: trial {ran.failed} failed; {ran.total - ran.before - ran.added} not begun",
            err=True,
        )
        raise typer.Exit(1)


def _soft_sensor(
    name: str,
    plan: Plan,
    laps: Path | None,
    model: str | None,
    sensors: str | None,
    map_file: Path | None,
    repair: bool,
    workers: int | None,
    outputs: Outputs,
) -> None:
    from bench.cli import campaign_soft_sensor as soft_sensor
    from bench.whole import whole
    from campaigns.errors import CampaignError
    from campaigns.narx_plan import NarxLeaveOneOut, NarxPerformance

    count = workers or os.cpu_count() or 1
    result: Any = None
    if isinstance(plan, NarxPerformance):
        result = soft_sensor.performance(plan, laps, model, map_file, repair, outputs.html)
    elif isinstance(plan, NarxLeaveOneOut):
        if laps is None:
            raise CampaignError(f"{name}: needs --laps DIR, a folder of recorded rides")
        instruments = sensors or "datasheet"
        result = soft_sensor.leave_one_out(plan, laps, instruments, map_file, repair, count, outputs.html)
    if outputs.json:
        with whole(outputs.json) as part:
            part.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
