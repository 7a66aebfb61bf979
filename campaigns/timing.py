"""Steps 2 to 4 of section V.5.2, timed: what Table V.13 holds, and the lowest clock that is fast enough.

Belongs here: riding the codes, statistics, the thesis's figures. Never: a layout, how a pin is probed.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.codec import Codec
from bench.errors import LapError
from bench.laps.lap import Lap
from bench.mdlog.logger import Schedule
from bench.rig import ride
from bench.run import prepare
from bench.sensors.parts import Sensors
from bench.watch import Watch
from campaigns.thesis import thesis
from targets.ecus import Build, build
from targets.errors import FirmwareError
from targets.firmware import STEP_ELF, clock
from targets.firmware.build import build as make
from targets.firmware.variants import LADDER
from targets.footprint import Footprint, deepest_stack, footprint, paint_stack
from targets.mcu.image import load
from targets.oscilloscope import Oscilloscope, Stopwatch
from targets.profile import Profile

CODES = tuple(STEP_ELF)
CLOCKS_HZ = (22_000_000, 84_000_000, 168_000_000)
"""Our reading of the table's three rows: the text names 22 MHz, and their ratios fit the other two."""

LIMIT_US = 1000.0
"""The real-time constraint of section V.5.2."""

MARGIN = 0.1
"""Of the limit that the slowest step leaves at the lowest clock."""

_PROFILED, _COMPARED = 10, 101
"""Steps that a profile counts, and cycles of the logger that each practice is timed over."""


@dataclass(frozen=True)
class Steps:
    """Steps of one code at one clock, as its pin showed them.

    pulses: (steps, 3) CPU cycles: by the model, at best, at worst (0 if it gives no bounds). narx: (steps,),
    those of them spent in the soft sensor alone. first: cycles of the first step after power-on, which is not
    among the others: it fills the delay lines. stack: bytes used at most. late: what the ECU missed.
    """

    code: str
    hz: int
    pulses: NDArray[np.int64]
    narx: NDArray[np.int64]
    first: int
    size: Footprint
    stack: int
    late: int

    def us(self, cycles: Any) -> Any:
        """Cycles at this clock, in microseconds."""
        return cycles * 1e6 / self.hz

    @property
    def bounds(self) -> tuple[float, float] | None:
        """Means at best and at worst, us; None if the cycle model gives no bounds."""
        best, worst = self.us(self.pulses[:, 1:].mean(axis=0))
        return (float(best), float(worst)) if worst else None

    @property
    def slowest_us(self) -> float:
        """The slowest step, the first one too, with the pessimistic figures where there are any."""
        return float(self.us(max(self.pulses[:, (0, 2)].max(), self.first)))

    def document(self) -> dict[str, Any]:
        """The figures in microseconds, the thesis's beside them where it has any."""
        us = self.us(self.pulses[:, 0])
        published = _published(self.code, self.hz)
        return {
            "code": self.code,
            "clock_mhz": self.hz / 1e6,
            "steps": len(us),
            "mean_us": float(us.mean()),
            "std_us": float(us.std()),
            "min_us": float(us.min()),
            "max_us": float(us.max()),
            "bounds_us": list(self.bounds) if self.bounds else None,
            "narx_mean_us": float(self.us(self.narx).mean()),
            "first_us": float(self.us(self.first)),
            "cycles": float(self.pulses[:, 0].mean()),
            "thesis_mean_us": published[0] if published else None,
            "thesis_std_us": published[1] if published else None,
        }


def frames_of(lap: Lap, one: Build, sensors: Sensors, steps: int) -> Schedule:
    """What the logger sends of the first `steps` cycles of `lap`; LapError if it has fewer."""
    frames = prepare(lap, (), one.needs(), f"ecu {one.role}", Codec(), sensors).now.frames
    if len(frames) == 0 or frames.cycle[-1] + 1 < steps:
        raise LapError(f"{lap.source or 'lap'}: shorter than the {steps} steps to be timed")
    return _first(frames, steps)


def measure(code: str, one: Build, frames: Schedule) -> Steps:
    """Ride `frames` on the emulated MCU with a probe on the step pin; the first step stands apart.

    Raises FirmwareError if the ECU does not answer every cycle.
    """
    ecu: Any = one.power_on()
    size = footprint(Path(one.image.source))
    paint_stack(ecu.mcu, size.ram_end)
    probe, narx = Oscilloscope(ecu.mcu), Stopwatch(ecu.mcu, "narx_step")
    watch = Watch(Codec(), one.role)
    failure = ride(frames, ecu, watch).failure
    pulses = probe.pulses()
    hz = int(ecu.mcu.hz)
    if failure or len(pulses) != watch.cycles:
        reason = failure or f"{len(pulses)} pulses in {watch.cycles} cycles"
        raise FirmwareError(f"{one.image.source} at {hz / 1e6:g} MHz: {reason}")
    late = watch.missed_inputs + watch.overruns
    stack = deepest_stack(ecu.mcu, size.ram_end)
    return Steps(code, hz, pulses[1:], narx.calls()[1:], int(pulses[0, 0]), size, stack, late)


def builds(base: Build, names: Sequence[str] = CODES) -> Iterator[Build]:
    """The ECU with each code. base: its calibration, and the final code."""
    for name in names:
        yield base if name == "final" else replace(base, image=build(elf=STEP_ELF[name]).image)


def codes(
    frames: Schedule, base: Build, clocks_hz: Sequence[int] = CLOCKS_HZ, names: Sequence[str] = CODES
) -> Iterator[Steps]:
    """Table V.13: each code at each clock, clock by clock. base: the calibration, and the final code."""
    for hz in clocks_hz:
        for name, one in zip(names, builds(base, names), strict=True):
            yield measure(name, replace(one, clock_hz=hz), frames)


def memory(steps: Steps, base: Build) -> dict[str, Any]:
    """The memory rows of Table V.13 for one code, bytes; the thesis's are in kB."""
    published = thesis()["firmware"]
    column = CODES.index(steps.code)
    calibration = len(base.calibration.image())
    return {
        "code": steps.code,
        "flash_bytes": steps.size.flash + calibration,
        "program_bytes": steps.size.flash,
        "calibration_bytes": calibration,
        "ram_bytes": steps.size.ram + steps.stack,
        "variables_bytes": steps.size.ram,
        "stack_bytes": steps.stack,
        "thesis_flash_kB": published["flash_kB"][column],
        "thesis_ram_kB": published["sram_kB"][column],
    }


def lowest_clock(
    frames: Schedule, base: Build, steps: Steps, limit_us: float = LIMIT_US, margin: float = MARGIN
) -> Steps | None:
    """The steps at the lowest clock at which even the slowest leaves `margin` of `limit_us`; None if at none.

    steps: the same code at some clock, from whose cycles the search starts. Every candidate is run: wait
    states and the bus change with the clock, too.
    """
    allowed_us = limit_us * (1 - margin)
    at_least = int(steps.slowest_us * steps.hz / allowed_us)
    for setting in clock.settings(at_least):
        found = measure(steps.code, replace(base, clock_hz=setting.hz), frames)
        if found.slowest_us <= allowed_us and not found.late:
            return found
    return None


def lowest_document(code: str, found: Steps | None) -> dict[str, Any]:
    """The lowest clock as figures, None where there is none."""
    return {
        "code": code,
        "clock_mhz": found.hz / 1e6 if found else None,
        "slowest_us": found.slowest_us if found else None,
        "limit_us": LIMIT_US,
        "margin": MARGIN,
        "thesis_clock_mhz": CLOCKS_HZ[0] / 1e6,
    }


def ladder(frames: Schedule, base: Build) -> list[dict[str, Any]]:
    """Each practice of STEPS 3 and 4 on top of those before it, at the slowest clock of the table.

    Raises FirmwareError where there is no compiler: these codes are not shipped.
    """
    rows = []
    few = _first(frames, _COMPARED)
    with TemporaryDirectory() as folder:
        for name, variant in LADDER.items():
            path = Path(folder) / f"{name}.elf"
            make(base.role, path, variant)
            one = replace(base, image=load(path), clock_hz=CLOCKS_HZ[0])
            steps = measure(name, one, few)
            rows.append(
                {
                    "practice": name,
                    "says": variant.says,
                    "mean_us": float(steps.us(steps.pulses[:, 0]).mean()),
                    "program_bytes": steps.size.flash,
                    "variables_bytes": steps.size.ram,
                }
            )
    return rows


def profile(frames: Schedule, base: Build) -> Profile:
    """Where the cycles of a step go, over a few steps after the warm-up or the last of `frames`."""
    ecu: Any = base.power_on()
    cycles = int(frames.cycle[-1]) + 1
    skip = max(1, min(base.calibration.detector.warmup + 1, cycles - _PROFILED))
    counted = Profile(ecu.mcu, skip)
    failure = ride(_first(frames, skip + _PROFILED), ecu, Watch(Codec(), base.role)).failure
    if failure:
        raise FirmwareError(f"{base.image.source}: {failure}")
    return counted


def _first(frames: Schedule, cycles: int) -> Schedule:
    kept = frames.cycle < cycles
    columns = ("t_ns", "ids", "extended", "lengths", "payload", "cycle")
    return replace(frames, **{name: getattr(frames, name)[kept] for name in columns})


def _published(code: str, hz: int) -> tuple[float, float] | None:
    """Mean and standard deviation of Table V.13, us; None where it has no row."""
    if hz not in CLOCKS_HZ:
        return None
    mean, deviation = thesis()["firmware"]["time_us"][CLOCKS_HZ.index(hz)][CODES.index(code)]
    return float(mean), float(deviation)
