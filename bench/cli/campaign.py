"""`bench campaign`: the published tables, ours beside them.

Belongs here: options, and which campaign goes where. Never: what is run, how a table is made.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from bench.cli.options import Host, Laps, Map, Repair, Workers, json_of, write_json

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
JsonOut = Annotated[Path | None, json_of("tables and trials")]
HtmlOut = Annotated[Path | None, typer.Option("--html", metavar="OUT", help="Write a page to look at.")]
CsvOut = Annotated[Path | None, typer.Option("--csv", metavar="OUT", help="Write the trials as CSV.")]
ParquetOut = Annotated[
    Path | None, typer.Option("--parquet", metavar="OUT", help="Write the trials as Parquet.")
]
JunitOut = Annotated[Path | None, typer.Option("--junit", metavar="OUT", help="Write verdicts as JUnit XML.")]

_NO_ECU = ("--on", "--ftti", "--junit")
_NO_STORE = ("--cluster", "--store", "--fail-fast", "--csv", "--parquet")
NOT_TAKEN = {
    "road": (),
    "offline": _NO_ECU,
    "narx_grid": (*_NO_ECU, "--laps", "--map", "--repair", "--model", "--html"),
    "narx_performance": (*_NO_ECU, *_NO_STORE),
    "narx_leave_one_out": (*_NO_ECU, *_NO_STORE, "--model"),
}
"""Kind of a campaign -> the options that mean nothing to it."""


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


@app.command(
    "resume",
    help="Go on with a campaign that was interrupted: its store must be there; only what is missing is run.",
)
@app.command("run")
def run(
    context: typer.Context,
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
    from bench.cli import campaign_run, campaign_soft_sensor
    from campaigns.errors import CampaignError
    from campaigns.narx_plan import NarxLeaveOneOut, NarxPerformance
    from campaigns.plan import load
    from campaigns.store import Store

    outputs = campaign_run.Outputs(json_out, html_out, csv_out, parquet_out, junit_out, ftti)
    resuming = context.info_name == "resume"
    where = campaign_run.executor(workers, cluster)
    path = store or Path(f"{Path(name).stem}.sqlite")
    outputs.check(path)
    plan = load(name)
    wrong = [option for option in NOT_TAKEN[plan.kind] if option in _given(context)]
    if wrong:
        raise CampaignError(f"{name}: a campaign of kind {plan.kind} takes no {', '.join(wrong)}")
    if (map_file or repair) and not laps:
        raise CampaignError("--map and --repair go with --laps")
    own = Laps(laps, map_file, repair) if laps else None
    if sensors and not isinstance(plan, NarxLeaveOneOut):
        plan = plan.model_copy(update={"sensors": sensors})
    if isinstance(plan, NarxPerformance | NarxLeaveOneOut):
        if resuming:
            raise CampaignError(f"{name}: keeps no store to go on with")
        count = campaign_run.processes(workers)
        write_json(json_out, campaign_soft_sensor.run(name, plan, own, model, sensors, count, html_out))
        return
    if resuming and not path.exists():
        raise CampaignError(f"{path}: no such store to go on with")
    ready = campaign_run.prepared(Path(name).stem, plan, model, on, own, workers)
    with Store.open(path, ready.campaign) as kept:
        ran = campaign_run.carry_out(ready, kept, where, fail_fast)
        if ran.before:
            typer.echo(f"bench: campaign: {ran.before} of {ran.total} trials were in {path}", err=True)
        campaign_run.report(kept, outputs)
    if ran.failed:
        typer.echo(f"bench: campaign: trial {ran.failed} failed; {ran.left} not begun", err=True)
        raise typer.Exit(1)


@app.command()
def report(
    store: Annotated[Path, typer.Argument(metavar="STORE", help="A campaign's store.")],
    against: Annotated[
        Path | None,
        typer.Option("--against", metavar="STORE", help="Another run: which verdicts changed since then."),
    ] = None,
    tolerance: Annotated[
        float | None,
        typer.Option(
            metavar="S",
            help="With --against: times to detect that differ by no more are equal.  [default: 0.01]",
        ),
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

    outputs = campaign_run.Outputs(json_out, html_out, csv_out, parquet_out, junit_out, ftti)
    outputs.check(store, *([against] if against else []))
    if against is None:
        if tolerance is not None:
            raise CampaignError("--tolerance goes with --against")
        with Store.read(store) as found:
            campaign_run.report(found, outputs)
        return
    if csv_out or parquet_out or junit_out or ftti is not None:
        raise CampaignError("--against takes --tolerance, --json and --html alone")
    with Store.read(store) as found, Store.read(against) as before:
        campaign_run.compare(found, before, outputs, tolerance)


def _given(context: typer.Context) -> set[str]:
    """The options on the command line."""
    found: set[str] = set()
    for parameter in context.command.params:
        source = context.get_parameter_source(str(parameter.name))
        if source is not None and source.name == "COMMANDLINE":
            found.update(parameter.opts)
    return found
