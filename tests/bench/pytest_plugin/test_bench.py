"""The bench in a suite: riding, markers, health, options, and what it refuses."""

import pytest

IDLE = """
def test_it(bench):
    bench.ride(1)
"""


def test_rides_to_its_end(suite):
    """A lap is ridden in steps and to its end; the verdict is then what a run of the command gives."""
    suite("""
def test_it(bench, faults):
    planned = faults.plan("rear_stroke:short@1+0.5")
    assert bench.now == 0.0
    bench.ride(0.5)
    bench.ride_to(0.8)
    assert bench.now == 0.8
    assert bench.verdict.outcome == "OK"
    verdict = bench.finish()
    assert bench.now == bench.end == 3.01
    assert (verdict.outcome, verdict.t_cmd_ns, verdict.td_ns > 0) == ("CD", 10**9, True)
    assert bench.finish() is verdict
    assert [(str(f.spec), f.state) for f in faults] == [("rear_stroke:short:to=gnd@1+0.5", "cleared")]
    assert (planned.t_cmd, planned.t_active, planned.t_end) == (1.0, 1.0, 1.5)
""").assert_outcomes(passed=1)


@pytest.mark.parametrize(
    ("ask", "said"),
    [
        ("bench.ride_to(0.5)", "LapError: ride to 0.500 s: bench time is 1.000 s already"),
        ("bench.ride(2.1)", "LapError: ride to 3.100 s: the lap ends at 3.010 s"),
        ("bench.finish(); bench.ride(0)", "LapError: ride to 3.010 s: this lap is finished"),
        ("faults.fire('rear_stroke:melt')", "FaultError: unknown kind 'melt'"),
        ("faults.plan('rear_stroke:open@0.9')", "too late to plan it: the earliest is 1.000 s"),
        ("faults.plan('rear_stroke:open')", "has no @TIME"),
        ("bus.signal('IFD_STATUS.warmth')", "BusError: message IFD_STATUS has no signal 'warmth'"),
        ("bus.signal('HUMIDITY.now')", "BusError: "),
        (
            "fault = faults.fire('rear_stroke:open@now+0.1'); bench.ride(0.2); fault.clear()",
            "nothing to clear",
        ),
    ],
)
def test_refuses(suite, ask, said):
    """What cannot be asked of a bench is refused in one line that names the value."""
    result = suite(f"""
def test_it(bench, faults, bus):
    bench.ride(1)
    {ask}
""")
    result.assert_outcomes(failed=1)
    assert any(said in line for line in result.outlines if line.startswith("E "))


@pytest.mark.parametrize(
    ("marker", "said"),
    [
        ("lap(rout='pave')", "marker lap: no argument rout; it takes route, motorcycle, seed"),
        ("lap('pave', 'naked700')", "marker lap: takes one plain argument, route"),
        ("lap(route='moon')", "route: unknown route 'moon'"),
        ("lap(file='none.csv')", "lap: */none.csv: no such file"),
        ("lap(file='lap.parquet', seed=3)", "lap: marker lap: file is lap.parquet, and seed of a simulation"),
        ("lap(file='lap.parquet', sensors='good')", "sensor: sensors 'good' are neither"),
        ("lap(file='lap.parquet', rate=7)", "lap: *7*"),
        ("ecu('abs')", "*: no ECU abs"),
        ("ecu(model='none.json')", "*none.json*"),
        ("ecu(clock_hz=1)", "*: clock 1e-06 MHz: no setting*"),
    ],
)
def test_bad_markers(suite, marker, said):
    """A marker that asks for what there is not is one line, without a traceback."""
    result = suite(f"@pytest.mark.{marker}{IDLE}")
    result.assert_outcomes(errors=1)
    result.stdout.fnmatch_lines(said + "*")
    assert "Traceback" not in result.stdout.str()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--bench-ecu", "real"], "ERROR: --bench-ecu real: a real ECU needs --bench-bus IFACE[[]:CHANNEL]"),
        (["--bench-ecu", "toaster"], "*--bench-ecu: invalid choice: 'toaster'*"),
        (["--bench-late-limit", "0"], "ERROR: --bench-late-limit 0.0: not from 0.1 to 1000 ms"),
        (["--bench-bitrate", "1"], "ERROR: --bench-bitrate 1: not from 10000 to 1000000 bit/s"),
    ],
)
def test_options_that_contradict(suite, words, said):
    """Options that make no bench are a usage error: one line and exit code 4."""
    result = suite(IDLE, *words)
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    result.stderr.fnmatch_lines([said])


def test_one_logger_to_a_bus(suite):
    """Workers that would share a live bus are a usage error."""
    pytest.importorskip("xdist")
    result = suite(IDLE, "-p", "xdist", "-n", "2", "--bench-bus", "virtual:x")
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    result.stderr.fnmatch_lines(["ERROR: --bench-bus virtual:x: a bus has one data logger; leave out -n"])


def test_bus_that_does_not_exist(suite):
    """An interface that cannot be opened is one line of each test that wanted it."""
    result = suite(IDLE, "--bench-bus", "carrier_pigeon:3", "--bench-ecu", "real")
    result.assert_outcomes(errors=1)
    result.stdout.fnmatch_lines(["bus: carrier_pigeon:3: no interface 'carrier_pigeon'*"])


def test_help(suite):
    """The options have a group of their own in pytest's help, the markers are in its list."""
    result = suite(IDLE, "--help")
    result.stdout.fnmatch_lines(["strokebench:*", "*--bench-bus*", "*--bench-ecu*", "*--bench-artifacts*"])
    result = suite(IDLE, "--markers")
    result.stdout.fnmatch_lines(
        ["@pytest.mark.lap(*", "@pytest.mark.ecu(*", "@pytest.mark.unhealthy_bus_ok*"]
    )


HUNG = """
    bench.ride(1)
    ecu.device.mcu.patch(ecu.device.mcu.image.symbol("ecu_step"), bytes.fromhex("fee7"))
    assert bench.finish().outcome == "INVALID"
"""


def test_unhealthy_bus_fails_at_teardown(suite):
    """A test that passes on a bus that is not well errors at its end, unless its marker says that it may."""
    result = suite(f"""
def test_it(bench, ecu):{HUNG}

@pytest.mark.unhealthy_bus_ok
def test_marked(bench, ecu):{HUNG}
""")
    result.assert_outcomes(passed=2, errors=1)
    result.stdout.fnmatch_lines(["bus unhealthy: ECU overrun: no answer to cycle *; pc 0x* in ecu_step*"])
    result.stdout.fnmatch_lines(["*freeze frame*"])


def test_unhealthy_bus_of_a_failure(suite):
    """A test that has failed already does not fail again for its bus: the freeze frame says it."""
    result = suite("""
def test_it(bench, ecu):
    bench.ride(1)
    ecu.device.mcu.patch(ecu.device.mcu.image.symbol("ecu_step"), bytes.fromhex("fee7"))
    bench.ride(1)
""")
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(
        ["E *expected the ride to go on; seen: ECU overrun*", "bus unhealthy: ECU overrun*"]
    )


def test_lap_is_made_once(suite):
    """A session reads or simulates a lap once, whoever asks; another marker is another lap."""
    suite("""
LAPS = []

@pytest.mark.parametrize("n", range(2))
@pytest.mark.lap(route="pave", seed=3, seconds=1.0)
def test_same(lap, n):
    LAPS.append(lap)
    assert lap is LAPS[0]

@pytest.mark.lap(route="pave", seed=4, seconds=1.0)
def test_other(lap):
    assert lap.source == "pave seed 4"
    assert lap.digest() not in [one.digest() for one in LAPS]
""").assert_outcomes(passed=3)


def test_lap_of_ones_own(suite):
    """A suite that overrides `lap` rides its own."""
    suite("""
@pytest.fixture
def lap(lap):
    from dataclasses import replace
    return replace(lap, source="mine")

def test_it(bench):
    bench.ride(0.1)
    assert bench.lap.source == "mine"
""").assert_outcomes(passed=1)


def test_soft_sensor(suite):
    """The other ECU of the project is tested alike, and has no alarm."""
    suite("""
@pytest.mark.ecu("soft_sensor", model="model.json")
def test_it(bench, ecu, bus):
    assert ecu.alarm.absent_for(1)
    assert len(bus.signal("SOFT_STROKE.predicted_mm").values) == 100
""").assert_outcomes(passed=1)


def test_suite_without_a_bench_imports_nothing(pytester, monkeypatch):
    """A suite that asks for no fixture of the bench does not import numpy, let alone the bench."""
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")
    pytester.makepyfile("""
import sys

def test_it():
    heavy = {"numpy", "numba", "can", "cantools", "bench.rig", "bench.pytest_plugin.ride"}
    assert not heavy & set(sys.modules)
""")
    pytester.runpytest_subprocess("-p", "bench.pytest_plugin").assert_outcomes(passed=1)
