"""Putting a test's bench together from its markers and the session's options.

Belongs here: which lap, ECU, bus and clock a test gets. Never: what it does with them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from bench.codec import Codec
from bench.panel import Panel
from bench.pytest_plugin.laps import beside, settings_of
from bench.pytest_plugin.refusals import arguments
from bench.pytest_plugin.ride import Bench
from bench.rig import Rig
from bench.run import prepare
from bench.sensors.datasheets import load_sensors
from bench.watch import Watch
from targets.ecus import CALIBRATIONS, build

if TYPE_CHECKING:
    from bench.laps.lap import Lap
    from targets.ecu import Ecu
    from targets.ecus import Build

HOSTS = {"emulated": "mcu", "host": "host"}
"""--bench-ecu -> where the target's room puts the ECU."""

ECU: dict[str, object] = {"role": "ifd", "model": None, "elf": None, "clock_hz": None}


@dataclass
class Fitted:
    """The ECU that a bench was given.

    hz: its CPU's clock, None if unknown: `why_no_clock` says why. complaints: what it said about itself when
    it was taken off a live bus.
    """

    role: str
    place: str
    build: Build | None = None
    device: Ecu | None = None
    hz: int | None = None
    complaints: list[str] = field(default_factory=list)

    @property
    def why_no_clock(self) -> str:
        """What to tell those who ask for times."""
        if self.place == "real":
            return "the clock of a real ECU is what @pytest.mark.ecu(clock_hz=...) says it is"
        return "the ECU runs on the host"

    def provenance(self) -> dict[str, str]:
        """What identifies it."""
        return self.build.provenance() if self.build else {"ecu": self.role, "runs_on": self.place}


@contextmanager
def assembled(
    item: pytest.Item, lap: Lap, refusing: Callable[[], AbstractContextManager[None]]
) -> Iterator[Bench]:
    """The bench of `item` for `lap`, at bench time 0; what cannot be had is refused within `refusing`."""
    with ExitStack() as stack:
        with refusing():
            made = _made(item, lap, stack)
        yield made


def _made(item: pytest.Item, lap: Lap, stack: ExitStack) -> Bench:
    options = item.config.getoption
    name, bitrate = options("--bench-bus"), options("--bench-bitrate")
    fitted = _fitted(item, options("--bench-ecu"), live=name is not None)
    instruments = settings_of(item)
    sensors = str(instruments["sensors"])
    if sensors.endswith(".toml"):
        sensors = str(beside(item, sensors))
    codec = Codec()
    watch = Watch(codec, fitted.role)
    script = prepare(
        lap,
        (),
        fitted.build.needs() if fitted.build else (),
        f"ecu {fitted.role}",
        codec,
        load_sensors(sensors),
        instruments["sensor_seed"],
        instruments["rate"],
    )
    if name is None:
        assert fitted.build is not None  # the options were checked: a real ECU has a bus
        fitted.device = fitted.build.power_on(bitrate)
        fitted.hz = _hz(fitted.device)
        return Bench(
            lap, script, watch, Rig(script, fitted.device, watch, bitrate), Panel(script), fitted, bitrate
        )

    from concurrent.futures import ThreadPoolExecutor

    from bench.bus.live import LiveBus
    from bench.live import LiveRig
    from bench.pytest_plugin.attached import attached

    limit_ns = round(options("--bench-late-limit") * 1e6)
    live = stack.enter_context(LiveBus(name, bitrate))
    executor = stack.enter_context(ThreadPoolExecutor(1, "planner"))
    if fitted.build:
        if fitted.place == "emulated":
            fitted.hz = _hz(fitted.build.power_on(bitrate))
        stack.enter_context(attached(fitted.build, name, bitrate, limit_ns, fitted.complaints))
    panel = Panel(script, executor)
    rig = LiveRig(script, live, watch, attend=[panel.settle], late_limit_ns=limit_ns)
    return Bench(lap, script, watch, rig, panel, fitted, bitrate, executor)


def _fitted(item: pytest.Item, place: str, live: bool) -> Fitted:
    settings: dict[str, Any] = arguments(item, "ecu", ECU, "role")
    clock_hz = settings["clock_hz"]
    if place == "real":
        return Fitted(settings["role"], place, hz=clock_hz)
    if place == "host":
        clock_hz = None  # it has none to set
    elif clock_hz and live:
        pytest.fail("marker ecu: clock_hz is set in virtual time only, or told of a real ECU", pytrace=False)
    model = settings["model"] and _model(item, settings["model"])
    elf = settings["elf"] and beside(item, settings["elf"])
    return Fitted(settings["role"], place, build(settings["role"], HOSTS[place], model, elf, clock_hz))


def _model(item: pytest.Item, name: str | Path) -> Path:
    """A shipped calibration by its name, or a file beside the test."""
    shipped = CALIBRATIONS / f"{name}.json"
    return shipped if "/" not in str(name) and shipped.exists() else beside(item, name)


def _hz(device: Ecu) -> int | None:
    """The clock of an ECU that has come out of reset, None on the host."""
    device.advance(0)
    mcu = getattr(device, "mcu", None)
    return mcu.hz if mcu else None
