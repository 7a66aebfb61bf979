"""One run, from a lap to a verdict: sensors, faults, logger, bus and ECU in virtual time.

Belongs here: the order of the rooms. Never: a file, a screen, which ECU it is.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from bench.codec import Codec
from bench.errors import FaultError, LapError
from bench.faults.insertion import Insertion
from bench.faults.resolve import resolve
from bench.faults.spec import FaultSpec
from bench.laps.lap import Lap
from bench.part import Part
from bench.rig import Ride, Rig
from bench.script import Script
from bench.sensors.codes import Codes, acquire
from bench.sensors.parts import IDEAL, Sensors
from bench.verdict import TD_MAX_NS, Verdict, judge
from bench.watch import Watch
from targets.ecu import Ecu

BITRATE = 500_000
WHOLE = Part()


@dataclass(frozen=True)
class Run:
    """A finished run: the verdict, and all it was read from."""

    verdict: Verdict
    watch: Watch
    ride: Ride
    insertions: Sequence[Insertion]
    codes: Codes
    bitrate: int = BITRATE


def prepare(
    lap: Lap,
    faults: Iterable[FaultSpec],
    needs: Sequence[str],
    who: str,
    codec: Codec,
    sensors: Sensors = IDEAL,
    seed: int = 0,
    rate_hz: int | None = None,
    part: Part = WHOLE,
) -> Script:
    """What the logger will send of `lap` under `faults`, for an ECU named `who` that needs channels `needs`.

    sensors: the instruments between lap and logger; `seed` draws their imperfections. rate_hz: of every
    message, None for the DBC's own. part: of the lap; times of faults count from its beginning.

    Raises LapError naming the channels that are missing, FaultError for a fault the lap cannot have.
    """
    lap.require(needs, who)
    faults = list(faults)
    for spec in faults:
        if not spec.resolved and part != WHOLE:
            raise FaultError(f"{spec}: begins or ends on a condition; that needs the whole lap, ridden once")
    specs = [resolve(spec, lap) for spec in faults]
    script = Script(part.of(acquire(lap, sensors, seed)), codec, specs, rate_hz)
    for name, missing in script.now.frames.unsent.items():
        carried = [channel for channel in needs if channel in codec.message(name).signals]
        if carried:
            raise LapError(
                f"{lap.source or 'lap'}: missing {', '.join(missing)}: message {name} is not sent, "
                f"and {who} needs its {', '.join(carried)}"
            )
    return script


def run_lap(
    lap: Lap,
    ecu: Ecu,
    faults: Iterable[FaultSpec] = (),
    needs: Sequence[str] = (),
    td_max_ns: int = TD_MAX_NS,
    progress: Callable[[int], None] | None = None,
    sensors: Sensors = IDEAL,
    seed: int = 0,
    rate_hz: int | None = None,
    bitrate: int = BITRATE,
) -> Run:
    """Ride `lap` with `ecu` on a timed bus while `faults` act, and judge what it said.

    sensors: the instruments that read the lap; `seed` draws their imperfections. rate_hz: of every message,
    None for the DBC's own. bitrate: of the bus, bit/s.

    Raises LapError if the lap lacks one of the channels `needs`, FaultError for a fault it cannot have.
    """
    codec = Codec()
    script = prepare(lap, faults, needs, f"ecu {ecu.name}", codec, sensors, seed, rate_hz)
    watch = Watch(codec, ecu.name)
    rig = Rig(script, ecu, watch, bitrate, progress)
    rig.finish()
    return finished(rig, script, watch, td_max_ns)


def finished(rig: Rig, script: Script, watch: Watch, td_max_ns: int = TD_MAX_NS) -> Run:
    """The run that `rig` has ridden of `script`, judged by what `watch` saw."""
    done, plan = rig.ridden(), script.now
    verdict = judge(watch, plan.insertions, done.failure, td_max_ns)
    return Run(verdict, watch, done, plan.insertions, plan.codes, rig.bitrate)


def document(run: Run) -> dict[str, Any]:
    """The run as plain data for JSON: times in seconds, None for what did not happen."""
    verdict, watch, load = run.verdict, run.watch, run.ride.load
    cycles = watch.step_cycles
    return {
        "outcome": str(verdict.outcome),
        "reason": verdict.reason,
        "t_cmd_s": _s(verdict.t_cmd_ns),
        "t_active_s": _s(verdict.t_active_ns),
        "t_obs_s": _s(verdict.t_obs_ns),
        "t_alarm_s": _s(verdict.t_alarm_ns),
        "t_heal_s": _s(verdict.t_heal_ns),
        "td_s": _s(verdict.td_ns),
        "faults": [
            {
                "spec": str(i.spec),
                "t_cmd_s": _s(i.t_cmd_ns),
                "t_active_s": _s(i.t_active_ns),
                "t_obs_s": _s(i.t_obs_ns),
            }
            for i in run.insertions
        ],
        "named": verdict.named,
        "alarms_s": [[_s(alarm.on_ns), _s(alarm.off_ns)] for alarm in watch.alarms],
        "input_cycles": watch.cycles,
        "answers": watch.answered,
        "unanswered": watch.unanswered_cycles,
        "step_cycles": {"min": min(cycles), "mean": sum(cycles) / len(cycles), "max": max(cycles)}
        if cycles
        else None,
        "bus": {
            "bitrate": run.bitrate,
            "load": load.load,
            "frames": len(run.ride.frames),
            "bits": load.bits,
            "worst_wait_s": {f"{key:#x}": traffic.worst_wait_ns / 1e9 for key, traffic in load.by_id.items()},
        },
        "saturated_samples": {sensor: count for sensor, count in run.codes.saturated.items() if count},
        "simulated_s": run.ride.end_ns / 1e9,
    }


def _s(t_ns: int | None) -> float | None:
    return None if t_ns is None else t_ns / 1e9
