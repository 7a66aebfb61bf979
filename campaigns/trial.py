"""One trial, carried out: simulate the lap, ride it, keep what the tables need."""

from collections.abc import Callable
from dataclasses import dataclass

from bench.faults.spec import parse_fault
from bench.plant.motorcycle import load_motorcycle
from bench.plant.ride import ride
from bench.plant.route import load_route
from bench.run import run_lap
from bench.sensors.datasheets import load_sensors
from bench.verdict import Outcome
from campaigns.plan import Trial
from targets.ecus import Build


@dataclass(frozen=True)
class Result:
    """What became of a trial. Times in ns; steps, cycles and squares are sums over the run's NARX steps."""

    trial: Trial
    outcome: Outcome
    reason: str
    td_ns: int | None
    ridden_ns: int
    steps: int
    cycles: int
    squares: int
    least: int
    most: int
    hz: int
    bus_load: float


def carry_out(trial: Trial, build: Build, progress: Callable[[int], None] | None = None) -> Result:
    """Ride the trial's lap with a fresh ECU of `build`."""
    lap = ride(load_route(trial.route), load_motorcycle(trial.motorcycle), trial.lap_seed, trial.seconds)
    sensors = load_sensors(trial.sensors)
    faults = [parse_fault(trial.fault)] if trial.fault else []
    ecu = build.power_on()
    run = run_lap(lap, ecu, faults, build.needs(), progress=progress, sensors=sensors, seed=trial.lap_seed)
    cycles = run.watch.step_cycles
    mcu = getattr(ecu, "mcu", None)
    return Result(
        trial,
        run.verdict.outcome,
        run.verdict.reason,
        run.verdict.td_ns,
        run.ride.end_ns,
        len(cycles),
        sum(cycles),
        sum(c * c for c in cycles),
        min(cycles, default=0),
        max(cycles, default=0),
        mcu.hz if mcu else 0,
        run.ride.load.load,
    )
