"""`bench replay`: the emulated MDLog on a live bus."""

import json
from pathlib import Path
from typing import Annotated

import typer

from bench.cli.options import BusName, Faults
from bench.cli.stop import stoppable


def replay(
    lap: Annotated[Path, typer.Argument(metavar="LAP", help="Lap file (.csv, .parquet).")],
    bus: BusName,
    fault: Faults = None,
    ecu: Annotated[
        str | None, typer.Option("--ecu", help="Judge the answers of this ECU: ifd or soft_sensor.")
    ] = None,
    json_out: Annotated[
        Path | None, typer.Option("--json", metavar="OUT", help="Write the result as JSON.")
    ] = None,
    record_out: Annotated[
        Path | None, typer.Option("--record", metavar="OUT", help="Record the bus (.log, .asc, .blf, .mf4).")
    ] = None,
) -> None:
    """Replay a lap onto a live CAN bus at its own pace; with --ecu also listen and judge.

    Exit code 0: replayed in time (with --ecu: and passed). 1: any other verdict. 2: bad input, or a bus that
    went away. 130: stopped before the end, nothing written.
    """
    from rich.console import Console
    from rich.markup import escape

    from bench.bus.live import LiveBus
    from bench.cli.progress import lap_progress
    from bench.codec import Codec
    from bench.faults.spec import parse_fault
    from bench.laps.files import read_lap
    from bench.live import replay as play
    from bench.recorder import check_target, record
    from bench.run import prepare
    from bench.verdict import judge
    from bench.watch import Watch
    from bench.whole import check_writable, whole

    if json_out:
        check_writable(json_out)
    if record_out:
        check_target(record_out)
    codec = Codec()
    specs = [parse_fault(text) for text in fault or []]
    ridden = read_lap(lap)
    _, insertions, frames = prepare(ridden, specs, (), "replay", codec)
    watch = Watch(codec, ecu) if ecu else None
    try:
        with LiveBus(bus) as live, stoppable(), lap_progress(ridden.duration_ns) as tell:
            done = play(frames, live, watch, tell)
    except KeyboardInterrupt:
        typer.echo("bench: replay: stopped before the lap's end; no verdict, nothing written", err=True)
        raise typer.Exit(130) from None
    console = Console()
    for name, channels in frames.unsent.items():
        console.print(f"not sent: {name}, the lap lacks {', '.join(channels)}", highlight=False)
    result = {
        "frames_sent": sum(node == "MDLOG" for _, _, node in done.frames),
        "frames_heard": sum(node != "MDLOG" for _, _, node in done.frames),
        "late_ms": {"worst": done.worst_late_ns / 1e6, "mean": done.mean_late_ns / 1e6},
    }
    passed = done.failure is None
    console.print(
        f"{result['frames_sent']} frames sent, {result['frames_heard']} heard; late by "
        f"{done.worst_late_ns / 1e6:.2f} ms at worst, {done.mean_late_ns / 1e6:.2f} ms on average",
        highlight=False,
        soft_wrap=True,
    )
    if watch:
        verdict = judge(watch, insertions, done.failure)
        passed = verdict.outcome.passed
        result |= {"outcome": str(verdict.outcome), "reason": verdict.reason, "answers": watch.answered}
        for name in ("t_active", "t_alarm", "td"):
            value = getattr(verdict, f"{name}_ns")
            result[f"{name}_s"] = None if value is None else value / 1e9
        reason = escape(verdict.reason)
        console.print(f"[bold]{verdict.outcome}[/]  {reason}", highlight=False, soft_wrap=True)
    elif done.failure:
        console.print(done.failure, highlight=False, markup=False, soft_wrap=True)
    if record_out:
        record(record_out, done.frames)
    if json_out:
        with whole(json_out) as part:
            part.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    if not passed:
        raise typer.Exit(1)
