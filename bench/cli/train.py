"""`bench train`: from a folder of laps to a calibration file."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bench.cli.options import Map, Repair, SensorsName, open_lap

if TYPE_CHECKING:
    from bench.laps.lap import Lap
    from bench.sensors.parts import Sensors
    from targets.calibration import Detector
    from targets.narx.network import Narx
    from targets.narx.sequences import Sequences
    from targets.narx.train import Report

app = typer.Typer(
    help="Train soft sensors (needs the extra `train`).",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)


@app.callback()
def _train() -> None:
    """Keep `narx` a command of its own while it is the only one."""


@app.command()
def narx(
    laps: Annotated[Path, typer.Option("--laps", metavar="DIR", help="Folder of lap files.")],
    out: Annotated[Path, typer.Option("--out", metavar="MODEL", help="Calibration file to write (.json).")],
    neurons: Annotated[int, typer.Option(help="Hidden neurons, N.")] = 15,
    delay: Annotated[int, typer.Option(help="Delays d_in, samples at 100 Hz.")] = 10,
    shift: Annotated[int, typer.Option(help="Samples by which the prediction runs ahead.")] = 0,
    seed: Annotated[int, typer.Option(help="First of the seeds to try.")] = 0,
    seeds: Annotated[int, typer.Option(help="So many seeds; the best on held-out laps is kept.")] = 4,
    sensors: SensorsName = "datasheet",
    map_file: Map = None,
    repair: Repair = False,
    json_out: Annotated[
        Path | None, typer.Option("--json", metavar="OUT", help="Write the report as JSON.")
    ] = None,
) -> None:
    """Train the rear stroke soft sensor (chapter III) on laps and write it as calibration data.

    The laps go through sensors and logger first: the network is trained on what the ECU sees. The detector's
    n is the smallest with which no training lap raises an alarm. Ctrl-C keeps the best network so far.
    """
    from bench.provenance import versions
    from bench.sensors.datasheets import load_sensors
    from bench.whole import check_writable, whole
    from targets.calibration import Calibration, Detector, dumps
    from targets.ifd import quiet_multiple
    from targets.narx.settings import Settings
    from targets.narx.train import train

    check_writable(out)
    if json_out:
        check_writable(json_out)
    instruments = load_sensors(sensors)
    ridden = _laps(laps, map_file, repair)
    data = _sequences(ridden, instruments)
    settings = Settings(
        neurons=neurons, delays=delay, shift=shift, seeds=tuple(range(seed, seed + max(seeds, 0)))
    )
    with _bar(settings) as tell:
        network, report = train(data, settings, tell)
    network = network.rounded()
    detector = Detector()
    detector = Detector(multiple=quiet_multiple(_residuals(network, data, detector), detector))
    provenance = {
        "made_by": "bench train narx",
        "versions": {name: v for name, v in versions().items() if name in ("strokebench", "numpy", "numba")},
        "seed": report.chosen,
        "sensors": instruments.name,
        "laps_sha256": {lap.source: lap.digest() for lap in ridden},
        "training": _quality(report, "training"),
        "held_out": _quality(report, "held_out"),
        "interrupted": report.interrupted,
    }
    calibration = Calibration(network, detector, provenance)
    with whole(out) as part:
        part.write_text(dumps(calibration), encoding="utf-8")
    if json_out:
        result = {"calibration": calibration.checksum, "candidates": _candidates(report), **provenance}
        with whole(json_out) as part:
            part.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    _print(report, detector, out)


def _laps(folder: Path, map_file: Path | None, repair: bool) -> "list[Lap]":
    from bench.errors import LapError
    from bench.laps.files import FORMATS

    if not folder.is_dir():
        raise LapError(f"{folder}: no such folder")
    files = sorted(path for path in folder.iterdir() if path.suffix.lower() in FORMATS)
    if not files:
        raise LapError(f"{folder}: no lap in it ({', '.join(FORMATS)})")
    return [open_lap(path, map_file, repair) for path in files]


def _sequences(laps: "list[Lap]", sensors: "Sensors") -> "Sequences":
    """The laps as the ECU sees them: through sensors and logger, at 100 Hz."""
    import numpy as np

    from bench.mdlog.logger import sampled
    from bench.sensors.codes import acquire
    from targets.narx.sequences import Sequences

    inputs, output = ("fork_stroke_mm", "pitch_rate_dps", "speed_kmh"), "rear_stroke_mm"
    runs = []
    for lap in laps:
        lap.require((*inputs, output), "training")
        seen = sampled(acquire(lap, sensors))
        runs.append((np.stack([seen[name] for name in inputs], axis=1), seen[output]))
    return Sequences(inputs, output, tuple(runs))


def _residuals(network: "Narx", data: "Sequences", detector: "Detector") -> list[Any]:
    """The detector's residual over every training lap, as the ECU forms it."""
    import numpy as np

    from targets.ifd import residual

    found = []
    for u, y in data.runs:
        predicted = network.free_run(u)
        ahead = np.full(network.shift, network.initial_mm)
        predicted = np.concatenate([ahead, predicted])[: len(y)]
        found.append(residual(predicted, y, detector))
    return found


def _quality(report: "Report", which: str) -> dict[str, float]:
    quality = getattr(report, which)
    return {"er_percent": quality.er_percent, "rmse_mm": quality.rmse, "skill": quality.skill}


def _candidates(report: "Report") -> list[dict[str, Any]]:
    return [
        {"seed": c.seed, "stable": c.stable, "iterations": c.iterations, "judges": c.judges}
        for c in report.candidates
    ]


def _bar(settings: Any) -> Any:
    from bench.cli.progress import training_progress

    return training_progress(settings)


def _print(report: "Report", detector: "Detector", out: Path) -> None:
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    console = Console()
    table = Table(title="Seeds: held-out Er, %, at the end of each stage", title_justify="left")
    stages = list(dict.fromkeys(name for c in report.candidates for name in c.judges))
    for column in ("seed", *stages, "stable"):
        table.add_column(column, justify="right")
    for c in report.candidates:
        figures = (f"{c.judges[name]:.2f}" if name in c.judges else "-" for name in stages)
        mark = " *" if c.seed == report.chosen else ""
        table.add_row(f"{c.seed}{mark}", *figures, "yes" if c.stable else "no")
    console.print(table)
    for name in ("training", "held_out"):
        q = getattr(report, name)
        console.print(
            f"{name.replace('_', '-')}: Er {q.er_percent:.2f} % (III.2), RMSE {q.rmse:.2f} mm, "
            f"skill {q.skill:.2f} against the best constant",
            highlight=False,
        )
    console.print(
        f"detector: T = {100 * detector.threshold:g} %, L = {detector.window * 10} ms, "
        f"n = {detector.multiple}, the smallest without an alarm on the training laps\n"
        f"written: {escape(str(out))}",
        highlight=False,
    )
    if report.interrupted:
        console.print("interrupted: the best network so far was kept")
