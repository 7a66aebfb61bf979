"""A road plan's trials: which lap, which fault, which instant, which ECU. Rides none."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from bench.errors import LapError
from bench.faults.spec import parse_fault
from bench.sensors.datasheets import load_sensors
from bench.sensors.transducers import TRANSDUCERS
from campaigns.errors import CampaignError
from campaigns.laps import Recorded, Simulated
from campaigns.outcomes import number
from campaigns.road_plan import DETECTOR, FAULT_FREE, LAP_PARAMETERS, LOAD, PHASE, RoadPlan
from campaigns.trial import RoadWork, Trial
from targets.ecus import Build

LAST_S = 1.0
"""A fault comes this long before a recorded lap ends, at the latest."""
PERIOD_MS = 10


@dataclass(frozen=True)
class LapFile:
    """A lap of one's own: its file's name in the folder, the lap's digest, how long it is, what it has."""

    file: str
    sha256: str
    duration_s: float
    channels: tuple[str, ...]

    def require(self, names: Iterable[str], who: str) -> None:
        """Raise LapError naming the channels that `who` needs and this lap lacks."""
        missing = [name for name in names if name not in self.channels]
        if missing:
            raise LapError(f"{self.file}: missing {', '.join(missing)}, needed by {who}")


class Builds:
    """The ECUs of a campaign: one for each calibration and set of detector settings that is asked for."""

    def __init__(self, base: Build) -> None:
        self.base = base
        self.all: list[Build] = []
        self._known: dict[str, int] = {}

    def index(self, parameters: dict[str, Any]) -> int:
        """The number of the ECU with what a sweep set of it."""
        changes = {
            name.removeprefix(DETECTOR): value
            for name, value in parameters.items()
            if name.startswith(DETECTOR)
        }
        key = repr((parameters.get("model"), changes))
        if key not in self._known:
            build = self.base
            if "model" in parameters:
                from targets.ecus import calibration_of

                build = replace(build, calibration=calibration_of(str(parameters["model"])))
            if changes:
                try:
                    build = replace(build, calibration=build.calibration.with_detector(**changes))
                except TypeError:
                    raise CampaignError(
                        f"sweep: this calibration's detector has no setting {', '.join(changes)}; it has "
                        f"{', '.join(vars(build.calibration.detector))}"
                    ) from None
            self._known[key] = len(self.all)
            self.all.append(build)
        return self._known[key]


def expand(
    plan: RoadPlan, base: Build, files: Sequence[LapFile] = (), **where: Any
) -> tuple[list[Trial], RoadWork]:
    """The trials in the order of the tables, fault-free laps first, and what carries them out.

    files: laps of one's own instead of simulated ones: each is ridden once without a fault, and in turn with
    one; where: how `RoadWork` reads them. Every condition has laps of its own; the points of a sweep share
    theirs, so that they can be compared. Raises CampaignError for a lap that ends before the faults come,
    LapError for one that lacks a channel, FaultError, RouteError and SensorError for what cannot be inserted,
    ridden and measured with.
    """
    for name in LAP_PARAMETERS:
        if files and name in plan.sweep:
            raise CampaignError(f"sweep.{name}: laps of one's own are as they were ridden")
    builds = Builds(base)
    numbers = {name: k for k, name in enumerate([FAULT_FREE, *plan.faults])}
    trials = []
    for condition, fault, parameters in plan.conditions():
        build = builds.index(parameters)
        ecu = builds.all[build].provenance()
        sensors = str(parameters.get("sensors", plan.sensors))
        count = plan.laps if fault else (len(files) or plan.healthy_laps)
        first = plan.seed + numbers[condition] * plan.laps
        if not fault and plan.healthy_laps > plan.laps:
            first = plan.seed + len(numbers) * plan.laps  # more laps than a condition has seeds
        for k in range(count):
            seed = first + k
            lap, length_s = _lap(plan, parameters, seed, files)
            spec = ""
            if fault:
                own = "@" in fault  # an instant of its own, none to be drawn
                at = "" if own else f"@{_instant(_window(plan, lap, length_s), seed, parameters.get(PHASE))}"
                spec = str(parse_fault(fault + at))
            trials.append(
                Trial(condition, parameters, lap, sensors, seed, spec, build, ecu, plan.td_max_s, plan.ftti_s)
            )
    _check_parts(trials)
    _check_channels(files, trials, builds.all)
    return trials, RoadWork(tuple(builds.all), **where)


def _check_parts(trials: Sequence[Trial]) -> None:
    """Refuse now what would only show when its turn comes, after hours perhaps."""
    for lap in dict.fromkeys(replace(t.lap, seed=0) for t in trials if isinstance(t.lap, Simulated)):
        lap.parts()
    for name in dict.fromkeys(trial.sensors for trial in trials):
        load_sensors(name)


def _check_channels(files: Sequence[LapFile], trials: Sequence[Trial], builds: Sequence[Build]) -> None:
    faults = dict.fromkeys((t.condition, parse_fault(t.fault).sensor) for t in trials if t.fault and files)
    for file in files:
        for build in builds:
            file.require(build.needs(), f"ecu {build.role}")
        for condition, sensor in faults:
            if sensor in TRANSDUCERS:  # a bus fault has no channel
                file.require((TRANSDUCERS[sensor].channel,), f"fault {condition}")


def _lap(
    plan: RoadPlan, parameters: dict[str, Any], seed: int, files: Sequence[LapFile]
) -> tuple[Simulated | Recorded, float | None]:
    if files:
        file = files[(seed - plan.seed) % len(files)]
        return Recorded(file.file, file.sha256), file.duration_s
    routes = [plan.route] if isinstance(plan.route, str) else plan.route
    route = str(parameters.get("route", routes[int(_draw(seed, 2).integers(len(routes)))]))
    motorcycle = str(parameters.get("motorcycle", plan.motorcycle))
    load_kg = parameters.get(LOAD, 0.0)
    if not number(load_kg):
        raise CampaignError(f"sweep.{LOAD}: {load_kg!r} is no number")
    return Simulated(route, motorcycle, seed, plan.seconds, float(load_kg)), plan.seconds


def _window(plan: RoadPlan, lap: Simulated | Recorded, length_s: float | None) -> tuple[float, float]:
    low, high = plan.fault_window_s
    if length_s is None:
        return low, high
    last = length_s - LAST_S
    if last < low:
        name = lap.file if isinstance(lap, Recorded) else f"route {lap.route}"
        raise CampaignError(f"{name}: {length_s:g} s long, but the faults come from {low:g} s on")
    return low, min(high, last)


def _instant(window: tuple[float, float], seed: int, phase: Any) -> str:
    """A whole millisecond of the window, drawn from the lap's seed; phase: in the control period."""
    low, high = (round(edge * 1000) for edge in window)
    drawn = int(_draw(seed, 1).integers(low, high + 1))
    if phase is None:
        return f"{drawn / 1000:.3f}"
    if not number(phase) or not 0 <= phase < PERIOD_MS:
        raise CampaignError(f"sweep.{PHASE}: {phase!r} is not within 0 to {PERIOD_MS}, the control period")
    return f"{(drawn // PERIOD_MS * PERIOD_MS + phase) / 1000:.6f}"


def _draw(seed: int, stream: int) -> np.random.Generator:
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence((seed, stream))))
