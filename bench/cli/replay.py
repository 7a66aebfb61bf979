"""`bench replay`: the emulated MDLog on a live bus."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bench.cli.ground_options import AllowInject, InjectFrom, Mavlink, SessionOut, Tlog, write_session
from bench.cli.options import (
    LATE_LIMIT_MS,
    Bitrate,
    BusName,
    Faults,
    Keys,
    LateLimit,
    Map,
    Rate,
    Repair,
    SensorSeed,
    SensorsName,
    json_of,
    ms_to_ns,
    open_lap,
    write_json,
)
from bench.cli.stop import stoppable

if TYPE_CHECKING:
    from bench.live import Replay
    from bench.script import Script
    from bench.watch import Watch


def replay(
    lap: Annotated[Path, typer.Argument(metavar="LAP", help="Lap file or recording.")],
    bus: BusName,
    fault: Faults = None,
    ecu: Annotated[
        str | None, typer.Option("--ecu", help="Judge the answers of this ECU: ifd or soft_sensor.")
    ] = None,
    bitrate: Bitrate = 500_000,
    rate: Rate = None,
    speed: Annotated[float, typer.Option(min=0.01, max=100, help="Bench time over the wall's.")] = 1.0,
    late_limit: LateLimit = LATE_LIMIT_MS,
    loop: Annotated[int, typer.Option(min=1, help="How often the lap is ridden, end to end.")] = 1,
    from_s: Annotated[
        float, typer.Option("--from", metavar="S", min=0, help="Begin there; other times count from it.")
    ] = 0.0,
    to_s: Annotated[
        float | None, typer.Option("--to", metavar="S", min=0, help="End there.  [default: the lap's end]")
    ] = None,
    sensors: SensorsName = "datasheet",
    seed: SensorSeed = 0,
    map_file: Map = None,
    repair: Repair = False,
    json_out: Annotated[Path | None, json_of("the result")] = None,
    record_out: Annotated[
        Path | None, typer.Option("--record", metavar="OUT", help="Record the bus (.log, .asc, .blf, .mf4).")
    ] = None,
    key: Keys = None,
    mavlink: Mavlink = None,
    allow_inject: AllowInject = False,
    inject_from: InjectFrom = None,
    tlog: Tlog = None,
    session: SessionOut = None,
) -> None:
    """Replay a lap onto a live CAN bus at its own pace; with --ecu also listen and judge.

    While it runs, keys (1 to 9, or those of --key, fire a fault, c clears, q quits), `bench fault` and a
    ground station arm, fire and clear faults.
    Exit code 0: replayed in time (with --ecu: and passed). 1: any other verdict. 2: bad input. 130: stopped
    before the end: recorded so far, no verdict.
    """
    from bench.bus.live import LiveBus
    from bench.cli.attendants import attending
    from bench.cli.ground_link import Ground
    from bench.cli.keyboard import key_faults
    from bench.cli.progress import lap_progress
    from bench.codec import Codec
    from bench.faults.spec import parse_fault
    from bench.live import LiveRig
    from bench.mdlog.events import noted
    from bench.part import Part
    from bench.recorder import check_target, record
    from bench.run import prepare
    from bench.sensors.datasheets import load_sensors
    from bench.session import Session
    from bench.watch import Watch
    from bench.whole import check_writable

    keys = key_faults(key or [])
    if json_out:
        check_writable(json_out)
    if record_out:
        check_target(record_out)
    if session:
        check_writable(session)
    ground = Ground(mavlink, allow_inject, inject_from, tlog)
    codec = Codec()
    specs = [parse_fault(text) for text in fault or []]
    instruments = load_sensors(sensors)
    ridden = open_lap(lap, map_file, repair)
    part = Part(round(from_s * 1e9), None if to_s is None else round(to_s * 1e9), loop)
    script = prepare(ridden, specs, (), "replay", codec, instruments, seed, rate, part)
    watch = Watch(codec, ecu) if ecu else None
    stopped = False
    with (
        LiveBus(bus, bitrate) as live,
        stoppable(),
        lap_progress(script.last_ns) as tell,
        attending(bus, script, ground.joining(watch, bitrate, speed), keys, tell.say) as attendants,
    ):
        rig = LiveRig(
            script, live, watch, tell, attend=attendants, speed=speed, late_limit_ns=ms_to_ns(late_limit)
        )
        ground.follow(rig.frames)
        try:
            rig.finish()
        except KeyboardInterrupt:
            stopped = True
    done = rig.replayed()
    for name, channels in script.now.frames.unsent.items():
        typer.echo(f"not sent: {name}, the lap lacks {', '.join(channels)}")
    if record_out:
        record(record_out, noted(done.frames, script.now.insertions, codec))
    if session:
        write_session(session, Session(lap.name, ridden, part, sensors, seed), script)
    if line := ground.line():
        typer.echo(line)
    if stopped:
        typer.echo(
            f"bench: replay: stopped at {rig.now_ns / 1e9:.3f} s, before the lap's end; no verdict", err=True
        )
        raise typer.Exit(130)
    result, passed = _judged(done, watch, script, bitrate)
    write_json(json_out, result | ground.document())
    if done.lost:
        raise done.lost
    if not passed:
        raise typer.Exit(1)


def _judged(
    done: "Replay", watch: "Watch | None", script: "Script", bitrate: int
) -> tuple[dict[str, Any], bool]:
    """The result for JSON and whether it passed; says both on the screen."""
    import numpy as np
    from rich.console import Console
    from rich.markup import escape

    from bench.bus.bits import frame_bits
    from bench.verdict import judge

    def say(text: str) -> None:
        console.print(text, highlight=False, soft_wrap=True)

    console = Console()
    late = done.late_ns if len(done.late_ns) else np.zeros(1, np.int64)
    lasted_ns = done.frames[-1][0] - done.frames[0][0] if done.frames else 0
    bits = sum(frame_bits(*frame) for _, frame, _ in done.frames)
    result: dict[str, Any] = {
        "frames_sent": sum(node == "MDLOG" for _, _, node in done.frames),
        "frames_heard": sum(node != "MDLOG" for _, _, node in done.frames),
        "frames_unsent": done.unsent,
        "queue_full": done.refused,
        "late_ms": {
            "p50": float(np.percentile(late, 50)) / 1e6,
            "p99": float(np.percentile(late, 99)) / 1e6,
            "worst": done.worst_late_ns / 1e6,
            "mean": done.mean_late_ns / 1e6,
        },
        "bus": {"bitrate": bitrate, "load": bits / bitrate / (lasted_ns / 1e9) if lasted_ns else 0.0},
        "faults": [str(spec) for spec in script.now.specs],
    }
    ms = result["late_ms"]
    say(
        f"{result['frames_sent']} frames sent, {result['frames_heard']} heard, {done.unsent} unsent "
        f"(queue full {done.refused} times); bus {100 * result['bus']['load']:.1f} % of {bitrate // 1000} "
        "kbit/s"
    )
    say(f"late by {ms['p50']:.3f} ms (p50), {ms['p99']:.3f} ms (p99), {ms['worst']:.3f} ms at worst")
    if watch is None:
        if done.failure:
            say(f"[bold]INVALID[/]  {escape(done.failure)}")
        return result, done.failure is None
    verdict = judge(watch, script.now.insertions, done.failure)
    result |= {"outcome": str(verdict.outcome), "reason": verdict.reason, "answers": watch.answered}
    for name in ("t_active", "t_alarm", "td"):
        value = getattr(verdict, f"{name}_ns")
        result[f"{name}_s"] = None if value is None else value / 1e9
    result["td_late_ms"] = None
    remark = ""
    if verdict.td_ns is not None and verdict.t_active_ns is not None and verdict.t_alarm_ns is not None:
        result["td_late_ms"] = done.worst_late_within(verdict.t_active_ns, verdict.t_alarm_ns) / 1e6
        remark = f"; the bench was late by at most {result['td_late_ms']:.2f} ms meanwhile"
    say(f"[bold]{verdict.outcome}[/]  {escape(verdict.reason)}{remark}")
    return result, verdict.outcome.passed
