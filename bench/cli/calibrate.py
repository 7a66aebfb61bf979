"""`bench calibrate`: a detector's thresholds, from fault-free laps alone.

Belongs here: options, files, what is printed. Never: a statistic.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bench.cli.options import Laps, Map, Model, Repair, SensorsName, json_of, write_json

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bench.laps.lap import Lap
    from targets.calibration import Calibration
    from targets.tuning import Tuning

app = typer.Typer(help="Set a detector's thresholds.", no_args_is_help=True, pretty_exceptions_enable=False)


@app.callback()
def _calibrate() -> None:
    """Keep `ifd` a command of its own while it is the only one."""


@app.command()
def ifd(
    laps: Annotated[Path, typer.Option("--laps", metavar="DIR", help="Folder of fault-free laps.")],
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="Calibration file to write (.json).")],
    model: Model = None,
    budget: Annotated[
        float,
        typer.Option("--budget", metavar="N", help="False alarms allowed per hour, all checks together."),
    ] = 0.005,
    loss: Annotated[
        float, typer.Option("--loss", metavar="PERCENT", help="The gain error that has to be found.")
    ] = 10.0,
    sensors: SensorsName = "datasheet",
    map_file: Map = None,
    repair: Repair = False,
    json_out: Annotated[Path | None, json_of("what the limits rest on")] = None,
) -> None:
    """Give the model's network the second detector, its limits and windows tuned on fault-free laps.

    Every lap counts as healthy: leave out any that is not. Limits are extrapolated to the budget from the
    highest peaks of each check; windows are those which find a lost calibration, and a held sensor, soonest.
    """
    from dataclasses import asdict

    from bench.sensors.datasheets import load_sensors
    from bench.whole import check_writable, whole
    from campaigns.soft_sensor import network, pairs, sequences
    from targets.calibration import dumps, load
    from targets.ecus import DEFAULT_CALIBRATION
    from targets.errors import TrainingError
    from targets.tuning import tune

    check_writable(out)
    if json_out:
        check_writable(json_out)
    if not 0 < loss < 100:
        raise TrainingError(f"--loss is {loss:g}; it must be more than 0 and less than 100 percent")
    if not 0 < budget < math.inf:
        raise TrainingError(f"--budget is {budget:g}; it must be more than 0")
    base = load(model or DEFAULT_CALIBRATION)
    instruments = load_sensors(sensors)
    healthy = Laps(laps, map_file, repair).read()
    data = sequences(healthy, instruments, base.network.inputs, base.network.output)
    tuning = tune(pairs(network("", base.network, data), data), budget, loss / 100)
    found = _found(tuning, loss)
    calibration = _with_checks(base, tuning, _provenance(instruments.name, healthy, found))
    with whole(out) as part:
        part.write_text(dumps(calibration), encoding="utf-8")
    _print(tuning, loss, out)
    write_json(json_out, {**found, "detector": asdict(tuning.checks), "baselines": calibration.baselines})


def _found(tuning: Tuning, loss: float) -> dict[str, Any]:
    """What the limits rest on, as plain data."""
    from campaigns.outcomes import finite

    return {
        "hours": tuning.hours,
        "budget_per_hour": tuning.budget_per_hour,
        "loss_percent": loss,
        "healthy": tuning.healthy,
        "td_s": {kind: finite(td_s) for kind, td_s in tuning.td_s.items()},
        "missed": tuning.missed,
    }


def _provenance(sensors: str, healthy: Sequence[Lap], found: dict[str, Any]) -> dict[str, Any]:
    from bench.provenance import OF_CALIBRATIONS, versions

    return {
        "made_by": "bench calibrate ifd",
        "versions": versions(OF_CALIBRATIONS),
        "sensors": sensors,
        "laps_sha256": {lap.source: lap.digest() for lap in healthy},
        **found,
    }


def _with_checks(base: Calibration, tuning: Tuning, provenance: dict[str, Any]) -> Calibration:
    """The same network with the second detector, and the baselines beside it."""
    from dataclasses import replace

    from targets.baselines import document

    return replace(
        base,
        detector=tuning.checks,
        provenance={**base.provenance, "detector": provenance},
        baselines={name: document(baseline) for name, baseline in tuning.baselines.items()},
    )


def _print(tuning: Tuning, loss: float, out: Path) -> None:
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    checks, seen, td, missed = tuning.checks, tuning.healthy, tuning.td_s, tuning.missed
    title = f"Second detector, tuned on {tuning.hours:.2f} h without a fault"
    table = Table(title=title, title_justify="left", caption_justify="left")
    for head in ("check", "window, s", "limit", "healthy", "mean TD, s", "missed"):
        table.add_column(head, justify="left" if head == "check" else "right")
    loss_seen = f"{seen['loss_threshold']:.4f}"
    rows = (
        ("rail", None, f"{checks.rail_steps} samples", f"{seen['rail_steps']:.0f}", None),
        ("repeated code", None, f"{checks.repeat_steps} samples", f"{seen['repeat_steps']:.0f}", None),
        ("motion", checks.hold_window, f"{checks.hold_ratio:.3f}", f"{seen['hold_ratio']:.3f}", "hold"),
        ("loss", checks.loss_window, f"{checks.loss_threshold:.4f}", loss_seen, "uncalibration"),
    )
    for name, window, limit, healthy, kind in rows:
        times = (f"{td[kind]:.2f}", f"{100 * missed[kind]:.1f} %") if kind else ("", "")
        table.add_row(name, f"{window / 100:g}" if window else "", limit, healthy, *times)
    table.caption = (
        f"For {tuning.budget_per_hour:g} false alarms per hour in all. Healthy: the most that was seen "
        f"without a fault.\nTD: of a hold, and of {loss:g} % lost, put into the same laps; missed: not in "
        f"10 s.\nWritten: {escape(str(out))}"
    )
    Console().print(table, highlight=False)
