"""`bench calibrate`: a detector's thresholds, from fault-free laps alone.

Belongs here: options, files, what is printed. Never: a statistic.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from bench.cli.options import Map, Model, Repair, SensorsName

MATTER = ("strokebench", "numpy", "numba")
"""Packages that can change a limit."""

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
    json_out: Annotated[
        Path | None, typer.Option("--json", metavar="OUT", help="Write what the limits rest on as JSON.")
    ] = None,
) -> None:
    """Give the model's network the second detector, its limits and windows tuned on fault-free laps.

    Every lap counts as healthy: leave out any that is not. Limits are extrapolated to the budget from the
    highest peaks of each check; windows are those which find a lost calibration, and a held sensor, soonest.
    """
    import math
    from dataclasses import asdict, replace

    from rich.console import Console
    from rich.table import Table

    from bench.cli.train import laps_in
    from bench.provenance import versions
    from bench.sensors.datasheets import load_sensors
    from bench.whole import check_writable, whole
    from campaigns.soft_sensor import network, sequences
    from targets.baselines import document
    from targets.calibration import dumps, load
    from targets.ecus import DEFAULT_CALIBRATION
    from targets.errors import TrainingError
    from targets.tuning import tune

    check_writable(out)
    if json_out:
        check_writable(json_out)
    if not (loss > 0 and loss < 100):
        raise TrainingError(f"--loss is {loss:g}; it must be more than 0 and less than 100 percent")
    if not (budget > 0 and math.isfinite(budget)):
        raise TrainingError(f"--budget is {budget:g}; it must be more than 0")
    base = load(model or DEFAULT_CALIBRATION)
    instruments = load_sensors(sensors)
    healthy = laps_in(laps, map_file, repair)
    data = sequences(healthy, instruments, base.network.inputs, base.network.output)
    predicted = network("", base.network, data).predictions
    tuning = tune([(p, y) for p, (_, y) in zip(predicted, data.runs, strict=True)], budget, loss / 100)
    found = {
        "hours": tuning.hours,
        "budget_per_hour": budget,
        "loss_percent": loss,
        "healthy": tuning.healthy,
        "td_s": tuning.td_s,
        "missed": tuning.missed,
    }
    provenance = {
        **base.provenance,
        "detector": {
            "made_by": "bench calibrate ifd",
            "versions": {name: v for name, v in versions().items() if name in MATTER},
            "sensors": instruments.name,
            "laps_sha256": {lap.source: lap.digest() for lap in healthy},
            **found,
        },
    }
    baselines = {name: document(baseline) for name, baseline in tuning.baselines.items()}
    calibration = replace(base, detector=tuning.checks, provenance=provenance, baselines=baselines)
    with whole(out) as part:
        part.write_text(dumps(calibration), encoding="utf-8")
    checks = tuning.checks
    title = f"Second detector, tuned on {tuning.hours:.2f} h without a fault"
    table = Table(title=title, title_justify="left")
    for head in ("check", "window, s", "limit", "healthy", "mean TD, s", "missed"):
        table.add_column(head, justify="left" if head == "check" else "right")
    seen, td, missed = tuning.healthy, tuning.td_s, tuning.missed
    rows = (
        ("rail", "", f"{checks.rail_steps} samples", f"{seen['rail_steps']:.0f}", "", ""),
        ("repeated code", "", f"{checks.repeat_steps} samples", f"{seen['repeat_steps']:.0f}", "", ""),
        (
            "motion",
            f"{checks.hold_window / 100:g}",
            f"{checks.hold_ratio:.3f}",
            f"{seen['hold_ratio']:.3f}",
            f"{td['hold']:.2f}",
            f"{100 * missed['hold']:.1f} %",
        ),
        (
            "loss",
            f"{checks.loss_window / 100:g}",
            f"{checks.loss_threshold:.4f}",
            f"{seen['loss_threshold']:.4f}",
            f"{td['uncalibration']:.2f}",
            f"{100 * missed['uncalibration']:.1f} %",
        ),
    )
    for row in rows:
        table.add_row(*row)
    table.caption = (
        f"For {budget:g} false alarms per hour in all. Healthy: the most that was seen without a fault.\n"
        f"TD: of a hold, and of {loss:g} % lost, put into the same laps; missed: not in 10 s.\nWritten: {out}"
    )
    table.caption_justify = "left"
    Console().print(table, highlight=False)
    if json_out:
        with whole(json_out) as part:
            report = {**found, "detector": asdict(checks), "baselines": baselines}
            part.write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
