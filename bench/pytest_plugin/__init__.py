"""The pytest plugin: a bench in a test suite. A rim of its own, beside the commands.

Belongs here: options, markers, fixtures and what they hang on a report. Never: what a fixture does; it has a
module of its own, imported when a test asks for it: a suite without a bench pays nothing. No module here has
the name of a fixture: once imported, it would stand in this package in the fixture's place.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from collections.abc import Generator, Iterator

    from bench.laps.lap import Lap
    from bench.pytest_plugin.handles import Faults
    from bench.pytest_plugin.ride import Bench
    from bench.pytest_plugin.signals import Bus
    from bench.pytest_plugin.under_test import EcuUnderTest

PLACES = ("emulated", "host", "real")
"""Where the ECU may be: on the emulated MCU, on the host, or on the far end of a live bus."""

BENCH: pytest.StashKey[Bench] = pytest.StashKey()
"""The bench of an item, once it has one."""

_FAILED: pytest.StashKey[bool] = pytest.StashKey()

MARKERS = (
    "lap(route='test_lap', motorcycle='gsxr1000', seed=1, seconds=20, file=None, map=None, repair=False, "
    "sensors='datasheet', sensor_seed=0, rate=None): the lap that the bench rides, simulated or from a file",
    "ecu(role='ifd', model=None, elf=None, clock_hz=None): the ECU under test, its calibration and image",
    "unhealthy_bus_ok: lost frames, overruns and an ECU that falls silent are what this test is about",
)


def pytest_addoption(parser: pytest.Parser) -> None:
    """The options of the group "strokebench"."""
    group = parser.getgroup("strokebench", "strokebench: a hardware-in-the-loop bench")
    group.addoption(
        "--bench-bus",
        metavar="IFACE[:CHANNEL]",
        help="Ride in wall time on this python-can interface, e.g. socketcan:vcan0; default: virtual time.",
    )
    group.addoption("--bench-bitrate", metavar="N", type=int, default=500_000, help="Of the bus, bit/s.")
    group.addoption(
        "--bench-late-limit",
        metavar="MS",
        type=float,
        default=10.0,
        help="In wall time: a frame or an answer so late fails the test; default: a control period, 10.",
    )
    group.addoption(
        "--bench-ecu",
        choices=PLACES,
        default="emulated",
        help="Where the ECU is: an emulated STM32F405 (default), the host, or real: on the bus already.",
    )
    group.addoption(
        "--bench-artifacts",
        metavar="DIR",
        help="Write each failing test's last seconds on the bus (.log) and freeze frame (.txt) there.",
    )


def pytest_configure(config: pytest.Config) -> None:
    """Register the markers, refuse options that contradict each other."""
    for marker in MARKERS:
        config.addinivalue_line("markers", marker)
    live = config.getoption("--bench-bus")
    if config.getoption("--bench-ecu") == "real" and live is None:
        raise pytest.UsageError("--bench-ecu real: a real ECU needs --bench-bus IFACE[:CHANNEL]")
    if live is not None and config.getoption("numprocesses", None):
        raise pytest.UsageError(f"--bench-bus {live}: a bus has one data logger; leave out -n")
    if not 0.1 <= config.getoption("--bench-late-limit") <= 1000:
        raise pytest.UsageError(
            f"--bench-late-limit {config.getoption('--bench-late-limit')}: not from 0.1 to 1000 ms"
        )
    if not 10_000 <= config.getoption("--bench-bitrate") <= 1_000_000:
        raise pytest.UsageError(
            f"--bench-bitrate {config.getoption('--bench-bitrate')}: not from 10000 to 1000000 bit/s"
        )


@pytest.fixture
def lap(request: pytest.FixtureRequest) -> Lap:
    """The lap of the marker `lap`; override it to bring one of your own."""
    from bench.pytest_plugin.laps import lap_of
    from bench.pytest_plugin.refusals import refusing

    with refusing():
        return lap_of(request.node)


@pytest.fixture
def bench(request: pytest.FixtureRequest, lap: Lap) -> Iterator[Bench]:
    """A bench with that lap and the ECU of the marker `ecu`, at bench time 0."""
    from bench.pytest_plugin.assembly import assembled
    from bench.pytest_plugin.health import complaints
    from bench.pytest_plugin.properties import properties
    from bench.pytest_plugin.refusals import refusing

    item = request.node
    with assembled(item, lap, refusing) as made:
        item.stash[BENCH] = made
        yield made
    item.user_properties.extend(properties(made))
    if item.stash.get(_FAILED, False) or item.get_closest_marker("unhealthy_bus_ok"):
        return  # the freeze frame says so beside what failed
    if found := complaints(made):
        pytest.fail(f"bus unhealthy: {'; '.join(found)}", pytrace=False)


@pytest.fixture
def ecu(bench: Bench) -> EcuUnderTest:
    """The ECU under test: its alarm, its step time."""
    return bench.ecu


@pytest.fixture
def bus(bench: Bench) -> Bus:
    """What went over the bus, as signals."""
    return bench.bus


@pytest.fixture
def faults(bench: Bench) -> Faults:
    """Faults: planned, fired, cleared."""
    return bench.faults


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Hang the freeze frame on the report of a failure."""
    report = yield
    if report.failed:
        already = item.stash.get(_FAILED, False)
        item.stash[_FAILED] = True
        made = item.stash.get(BENCH, None)
        if made is not None and not already:
            from bench.pytest_plugin.artifacts import keep
            from bench.pytest_plugin.freeze_frame import freeze_frame

            text = freeze_frame(made, call.excinfo.value if call.excinfo else None)
            report.sections.append(("freeze frame", text))
            folder = item.config.getoption("--bench-artifacts")
            if folder is not None:
                report.sections.append(("bench artifacts", keep(folder, item.nodeid, made, text)))
    return report
