"""`bench train`: from a folder of laps to a calibration file.

Belongs here: options, files, tables. Never: an iteration, a measure.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bench.cli.options import Laps, Map, Repair, SensorsName, json_of, write_json

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from bench.laps.lap import Lap
    from targets.calibration import Detector
    from targets.narx.network import Narx
    from targets.narx.sequences import Sequences
    from targets.narx.train import Report, State

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
    recipe: Annotated[
        str, typer.Option(help="parallel (closed-loop error), or series-parallel as in the thesis.")
    ] = "parallel",
    inputs: Annotated[
        str | None,
        typer.Option(
            metavar="NAMES", help="Channels, by commas.  [default: the thesis's that every lap has]"
        ),
    ] = None,
    output: Annotated[str, typer.Option(metavar="NAME", help="Channel to predict.")] = "rear_stroke_mm",
    antialias: Annotated[
        bool, typer.Option("--antialias", help="Resample through a zero-phase low-pass (III.2).")
    ] = False,
    edit: Annotated[bool, typer.Option("--edit", help="Replace outliers beyond 3 sigma (III.2).")] = False,
    device: Annotated[str, typer.Option(help="Where matrices are multiplied: cpu or cuda.")] = "cpu",
    sensors: SensorsName = "datasheet",
    map_file: Map = None,
    repair: Repair = False,
    test: Annotated[
        Path | None, typer.Option("--test", metavar="DIR", help="Unseen laps to measure the result on.")
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on where an interrupted training left off.")
    ] = False,
    json_out: Annotated[Path | None, json_of("the report")] = None,
) -> None:
    """Train a soft sensor (chapter III) on laps and write it as calibration data.

    The laps go through sensors and logger first: the network is trained on what the ECU sees. The detector's
    n is the smallest with which no training lap raises an alarm. Ctrl-C keeps the best network so far, and
    MODEL.part from which --resume goes on. A MODEL that was better on the same laps is not overwritten.
    """
    from bench.cli.progress import training_progress
    from bench.sensors.datasheets import load_sensors
    from bench.whole import check_writable, whole
    from campaigns.soft_sensor import inputs_of, ranges, sequences
    from targets.calibration import Calibration, dumps
    from targets.narx.settings import Settings, recipe_of, relative_suits
    from targets.narx.train import train

    check_writable(out)
    if json_out:
        check_writable(json_out)
    stages = recipe_of(recipe)
    instruments = load_sensors(sensors)
    ridden = Laps(laps, map_file, repair).read()
    names = inputs_of(ridden, inputs.split(",") if inputs else None, output)
    data = sequences(ridden, instruments, names, output, antialias)
    unseen = Laps(test, map_file, repair).read() if test else []
    settings = Settings(
        neurons=neurons,
        delays=delay,
        shift=shift,
        seeds=tuple(range(seed, seed + max(seeds, 0))),
        edit=edit,
        device=device,
        ranges=ranges(),
        relative=relative_suits(data, ranges()[output]),
        **stages,
    )
    part = out.with_name(f"{out.name}.part")
    with training_progress(settings) as tell:
        network, report = train(data, settings, tell, _state(part) if resume else None, _saver(part))
    network = network.rounded()
    provenance = _provenance(report, instruments.name, recipe, ridden)
    detector = _detector(network, data)
    calibration = Calibration(network, detector, provenance)
    target = _target(out, provenance)
    with whole(target) as file:
        file.write_text(dumps(calibration), encoding="utf-8")
    if not report.interrupted:
        part.unlink(missing_ok=True)
    result = {"calibration": calibration.checksum, "candidates": _candidates(report), **provenance}
    _print(report, detector, target)
    if unseen:
        result["test"] = _tested(network, data, sequences(unseen, instruments, names, output, antialias))
    write_json(json_out, result)
    if target != out:
        typer.echo(f"bench: train: {out} was better on these laps and is kept", err=True)
        raise typer.Exit(1)


def _state(part: Path) -> State:
    from targets.errors import TrainingError

    try:
        state: State = json.loads(part.read_text(encoding="utf-8"))
    except OSError as error:
        raise TrainingError(f"{part}: nothing to resume: {error.strerror}") from None
    except ValueError:
        raise TrainingError(f"{part}: not the state of a training") from None
    return state


def _saver(part: Path) -> Callable[[State], None]:
    from bench.whole import whole

    def save(state: State) -> None:
        with whole(part) as file:
            file.write_text(json.dumps(state), encoding="utf-8")

    return save


def _target(out: Path, provenance: dict[str, Any]) -> Path:
    """`out`, or a name beside it if `out` holds a better result from the same laps."""
    from targets.calibration import load
    from targets.errors import TargetError

    if not out.exists():
        return out
    try:
        old = load(out).provenance
        better = (
            old["laps_sha256"] == provenance["laps_sha256"]
            and old["held_out"]["rmse_mm"] < provenance["held_out"]["rmse_mm"]
        )
    except (TargetError, KeyError, TypeError):
        return out  # no calibration, or none of ours
    return out.with_name(f"{out.stem}.worse{out.suffix}") if better else out


def _detector(network: Narx, data: Sequences) -> Detector:
    """The thesis's, with the smallest n that raises no alarm on any training lap, as the ECU would."""
    from campaigns.soft_sensor import network as free_run
    from campaigns.soft_sensor import pairs
    from targets.calibration import Detector
    from targets.ifd import quiet_multiple, residual

    detector = Detector()
    if network.output != "rear_stroke_mm":
        return detector
    residuals = [residual(p, y, detector) for p, y in pairs(free_run("", network, data), data)]
    return Detector(multiple=quiet_multiple(residuals, detector))


def _provenance(report: Report, sensors: str, recipe: str, laps: Sequence[Lap]) -> dict[str, Any]:
    from bench.provenance import OF_CALIBRATIONS, versions

    return {
        "made_by": "bench train narx",
        "versions": versions(OF_CALIBRATIONS),
        "seed": report.chosen,
        "sensors": sensors,
        "recipe": recipe,
        "laps_sha256": {lap.source: lap.digest() for lap in laps},
        "training": _quality(report, "training"),
        "held_out": _quality(report, "held_out"),
        "interrupted": report.interrupted,
    }


def _quality(report: Report, which: str) -> dict[str, float]:
    quality = getattr(report, which)
    return {"er_percent": quality.er_percent, "rmse_mm": quality.rmse, "skill": quality.skill}


def _candidates(report: Report) -> list[dict[str, Any]]:
    return [
        {"seed": c.seed, "stable": c.stable, "iterations": c.iterations, "judges": c.judges}
        for c in report.candidates
    ]


def _tested(network: Narx, training: Sequences, unseen: Sequences) -> dict[str, Any]:
    """Figures on unseen laps beside the baselines; prints them."""
    from rich.console import Console

    from campaigns.soft_sensor import baselines
    from campaigns.soft_sensor import network as free_runs
    from campaigns.soft_sensor_tables import figures, performance_table

    rows = figures([free_runs("network", network, unseen), *baselines(training, unseen, None)], unseen)
    Console().print(performance_table(rows, f"{len(unseen.runs)} unseen laps"), highlight=False)
    return {name: row.document() for name, row in rows.items()}


def _print(report: Report, detector: Detector, out: Path) -> None:
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    console = Console()
    table = Table(title="Seeds: held-out error at the end of each stage", title_justify="left")
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
    for name, share in report.edited.items():
        console.print(f"edited: {100 * share:.2f} % of {name}", highlight=False)
    console.print(
        f"detector: T = {100 * detector.threshold:g} %, L = {detector.window * 10} ms, "
        f"n = {detector.multiple}, the smallest without an alarm on the training laps\n"
        f"written: {escape(str(out))}",
        highlight=False,
    )
    if report.interrupted:
        console.print("interrupted: the best network so far was kept; --resume goes on")
