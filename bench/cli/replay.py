"""`bench replay`: the emulated MDLog on a live bus."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bench.cli.options import (
    BusName,
    Faults,
    Map,
    Repair,
    SensorSeed,
    SensorsName,
    json_of,
    open_lap,
    write_json,
)
from bench.cli.stop import stoppable

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bench.faults.insertion import Insertion
    from bench.live import Replay
    from bench.watch import Watch


def replay(
    lap: Annotated[Path, typer.Argument(metavar="LAP", help="Lap file or recording.")],
    bus: BusName,
    fault: Faults = None,
    ecu: Annotated[
        str | None, typer.Option("--ecu", help="Judge the answers of this ECU: ifd or soft_sensor.")
    ] = None,
    sensors: SensorsName = "datasheet",
    seed: SensorSeed = 0,
    map_file: Map = None,
    repair: Repair = False,
    json_out: Annotated[Path | None, json_of("the result")] = None,
    record_out: Annotated[
        Path | None, typer.Option("--record", metavar="OUT", help="Record the bus (.log, .asc, .blf, .mf4).")
    ] = None,
) -> None:
    """Replay a lap onto a live CAN bus at its own pace; with --ecu also listen and judge.

    Exit code 0: replayed in time (with --ecu: and passed). 1: any other verdict. 2: bad input, or a bus that
    went away. 130: stopped before the end, nothing written.
    """
    from bench.bus.live import LiveBus
    from bench.cli.progress import lap_progress
    from bench.codec import Codec
    from bench.faults.spec import parse_fault
    from bench.live import replay as play
    from bench.mdlog.events import noted
    from bench.recorder import check_target, record
    from bench.run import prepare
    from bench.sensors.datasheets import load_sensors
    from bench.watch import Watch
    from bench.whole import check_writable

    if json_out:
        check_writable(json_out)
    if record_out:
        check_target(record_out)
    codec = Codec()
    specs = [parse_fault(text) for text in fault or []]
    instruments = load_sensors(sensors)
    ridden = open_lap(lap, map_file, repair)
    _, insertions, frames = prepare(ridden, specs, (), "replay", codec, instruments, seed)
    watch = Watch(codec, ecu) if ecu else None
    try:
        with LiveBus(bus) as live, stoppable(), lap_progress(ridden.duration_ns) as tell:
            done = play(frames, live, watch, tell)
    except KeyboardInterrupt:
        typer.echo("bench: replay: stopped before the lap's end; no verdict, nothing written", err=True)
        raise typer.Exit(130) from None
    for name, channels in frames.unsent.items():
        typer.echo(f"not sent: {name}, the lap lacks {', '.join(channels)}")
    result, passed = _judged(done, watch, insertions)
    if record_out:
        record(record_out, noted(done.frames, insertions, codec))
    write_json(json_out, result)
    if not passed:
        raise typer.Exit(1)


def _judged(
    done: "Replay", watch: "Watch | None", insertions: "Sequence[Insertion]"
) -> tuple[dict[str, Any], bool]:
    """The result for JSON and whether it passed; says both on the screen."""
    from rich.console import Console
    from rich.markup import escape

    from bench.verdict import judge

    console = Console()
    result: dict[str, Any] = {
        "frames_sent": sum(node == "MDLOG" for _, _, node in done.frames),
        "frames_heard": sum(node != "MDLOG" for _, _, node in done.frames),
        "late_ms": {"worst": done.worst_late_ns / 1e6, "mean": done.mean_late_ns / 1e6},
    }
    console.print(
        f"{result['frames_sent']} frames sent, {result['frames_heard']} heard; late by "
        f"{done.worst_late_ns / 1e6:.2f} ms at worst, {done.mean_late_ns / 1e6:.2f} ms on average",
        highlight=False,
        soft_wrap=True,
    )
    if watch is None:
        if done.failure:
            console.print(done.failure, highlight=False, markup=False, soft_wrap=True)
        return result, done.failure is None
    verdict = judge(watch, insertions, done.failure)
    result |= {"outcome": str(verdict.outcome), "reason": verdict.reason, "answers": watch.answered}
    for name in ("t_active", "t_alarm", "td"):
        value = getattr(verdict, f"{name}_ns")
        result[f"{name}_s"] = None if value is None else value / 1e9
    reason = escape(verdict.reason)
    console.print(f"[bold]{verdict.outcome}[/]  {reason}", highlight=False, soft_wrap=True)
    return result, verdict.outcome.passed
