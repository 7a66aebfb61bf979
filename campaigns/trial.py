"""One trial of a road campaign: what decides it, and carrying it out."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bench.errors import LapError
from bench.faults.spec import parse_fault
from bench.laps.lap import Lap
from bench.run import Run, run_lap
from bench.sensors.datasheets import load_sensors
from campaigns.freeze import freeze
from campaigns.laps import Recorded, Simulated
from campaigns.store import Document, Identified
from targets.ecus import Build


@dataclass(frozen=True)
class Trial(Identified):
    """One lap under one condition, with one ECU.

    condition: a key of the plan's faults, or FAULT_FREE. parameters: what a sweep set. fault: its
    specification, '' for none. build: which of the campaign's ECUs; ecu: what identifies that one.
    """

    condition: str
    parameters: Mapping[str, Any]
    lap: Simulated | Recorded
    sensors: str
    sensors_seed: int
    fault: str
    build: int
    ecu: Mapping[str, str]
    td_max_s: float = 120.0
    ftti_s: float | None = None

    def document(self) -> Document:
        """See `Identified`."""
        return {
            "kind": "road",
            "condition": self.condition,
            "parameters": dict(self.parameters),
            "lap": self.lap.document(),
            "sensors": self.sensors,
            "sensors_seed": self.sensors_seed,
            "fault": self.fault,
            "td_max_s": self.td_max_s,
            "ftti_s": self.ftti_s,
            "ecu": dict(self.ecu),
        }


@dataclass(frozen=True)
class RoadWork:
    """Carries out trials, in whatever process: with these ECUs, and the laps of this folder."""

    builds: tuple[Build, ...]
    folder: Path | None = None
    map_file: Path | None = None
    repair: bool = False

    def __call__(self, trial: Trial) -> tuple[Document, Document | None]:
        """The result of a trial and its freeze frame."""
        run, hz = self.ridden(trial)
        return result(run, hz), freeze(run)

    def ridden(self, trial: Trial, progress: Callable[[int], None] | None = None) -> tuple[Run, int]:
        """The run of a trial with a fresh ECU, and its clock in Hz, 0 where it has none."""
        build = self.builds[trial.build]
        faults = [parse_fault(trial.fault)] if trial.fault else []
        ecu = build.power_on()
        run = run_lap(
            self.lap(trial),
            ecu,
            faults,
            build.needs(),
            round(trial.td_max_s * 1e9),
            progress,
            load_sensors(trial.sensors),
            trial.sensors_seed,
        )
        mcu = getattr(ecu, "mcu", None)
        return run, mcu.hz if mcu else 0

    def lap(self, trial: Trial) -> Lap:
        """The lap of a trial. Raises LapError for a file that is another lap by now."""
        source = trial.lap
        if isinstance(source, Simulated):
            return source.ridden()
        from bench.laps.channel_map import load_map
        from bench.laps.files import read_lap

        assert self.folder is not None
        path = self.folder / source.file
        lap = read_lap(path, load_map(self.map_file) if self.map_file else None, self.repair)
        if lap.digest() != source.sha256:
            raise LapError(f"{path}: is not the lap that the campaign began with")
        return lap


def result(run: Run, hz: int) -> Document:
    """What the store keeps of a run; times in ns after the lap's start."""
    verdict, cycles = run.verdict, run.watch.step_cycles
    return {
        "outcome": str(verdict.outcome),
        "reason": verdict.reason,
        "named": verdict.named,
        "t_cmd_ns": verdict.t_cmd_ns,
        "t_active_ns": verdict.t_active_ns,
        "t_obs_ns": verdict.t_obs_ns,
        "t_alarm_ns": verdict.t_alarm_ns,
        "t_heal_ns": verdict.t_heal_ns,
        "td_ns": verdict.td_ns,
        "alarms": len(run.watch.alarms),
        "ridden_ns": run.ride.end_ns,
        "steps": {
            "n": len(cycles),
            "cycles": sum(cycles),
            "squares": sum(c * c for c in cycles),
            "least": min(cycles, default=0),
            "most": max(cycles, default=0),
            "hz": hz,
        },
        "bus_load": run.ride.load.load,
    }
