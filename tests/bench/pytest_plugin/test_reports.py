"""What a suite on the bench leaves behind: freeze frames, artifacts, JUnit properties."""

from xml.etree import ElementTree

import can
import pytest

LATE = """
def test_it(bench, ecu, faults):
    bench.ride(1)
    faults.fire("rear_stroke:short@now+1")
    ecu.alarm.within(0.05)
"""


@pytest.fixture
def late(suite):
    """The output of a test whose alarm came too late, from its freeze frame on."""
    result = suite(LATE)
    result.assert_outcomes(failed=1)
    lines = result.outlines
    return lines[next(k for k, line in enumerate(lines) if "- freeze frame -" in line) :]


def test_freeze_frame_says_where_it_stands(late):
    """The freeze frame has bench time, verdict so far, instants, faults with states and the last values."""
    text = "\n".join(late)
    for said in (
        "bench time 1.050 s of 3.010 s, virtual time; ecu ifd, emulated; lap lap.parquet",
        "so far MD: no alarm after rear_stroke:short:to=gnd@1.000000001+1",
        "  t_cmd     1.000 s",
        "  t_active  1.001 s",
        "  deadline  1.050 s  t_active + 0.049 s",
        "  0  active  rear_stroke:short:to=gnd@1.000000001+1",
        "  STROKES        1.040 s  fork_stroke_mm ",
        " kind 0 (none)",
    ):
        assert said in text


def test_freeze_frame_draws_the_waveform(late):
    """Measured and predicted stroke and residual are drawn, with a mark below each instant's column."""
    for name in ("measured rear_stroke_mm, mm", "predicted_mm, mm", "residual_pct, pct"):
        assert name in late
    at = {}
    for line in late:
        for name in ("t_cmd", "t_active", "deadline"):
            if f"{name} 1.0" in line and "^" in line:
                at[name] = line.index("^")
    assert at["t_cmd"] <= at["t_active"] < at["deadline"] == max(at.values())
    top = late.index("measured rear_stroke_mm, mm")
    drawn = late[top + 1 : top + 7]
    assert any("⠤" <= cell <= "⣿" for line in drawn for cell in line)
    assert any(line[at["t_cmd"] : at["t_cmd"] + 1] == "┊" for line in drawn)


def test_freeze_frame_without_a_frame(suite):
    """A failure before the ride began has a freeze frame, too: there is nothing to draw, and it says so."""
    result = suite("""
def test_it(bench):
    assert bench.now
""")
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["no fault", "no frame was heard", "no waveform: too little has been ridden"])


def test_no_freeze_frame_where_nothing_failed(suite):
    """A test that passes, and one without a bench that fails, have none."""
    result = suite("""
def test_passes(bench):
    bench.ride(0.1)

def test_fails():
    assert not "a"
""")
    result.assert_outcomes(passed=1, failed=1)
    result.stdout.no_fnmatch_line("*freeze frame*")


def test_artifacts(suite, pytester):
    """A failing test leaves its bus as a log that python-can reads, the fault noted, and its freeze frame."""
    result = suite(LATE, "--bench-artifacts", "left/here")
    result.assert_outcomes(failed=1)
    log, text = sorted((pytester.path / "left" / "here").iterdir())
    assert log.name.startswith("test_suite.py-test_it-")
    assert (log.suffix, text.suffix) == (".log", ".txt")
    assert text.read_text(encoding="utf-8").startswith("bench time 1.050 s of 3.010 s")
    with can.LogReader(log) as reader:
        messages = list(reader)
    assert {message.arbitration_id for message in messages} >= {0x100, 0x101, 0x200, 0x7E0}
    assert messages[-1].timestamp <= 1.05


def test_artifacts_that_cannot_be_written(suite, pytester):
    """Where nothing can be written the report says so in a line, and is whole."""
    (pytester.path / "left").write_text("a file")
    result = suite(LATE, "--bench-artifacts", "left")
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["*residual_pct, pct", "record: left: cannot be made: *"])


def test_junit_properties(suite, pytester):
    """A JUnit report has each test's outcome, instants, worst step, bus load, lap's and ECU's digests."""
    suite(
        """
def test_it(bench, ecu, faults):
    faults.plan("rear_stroke:short@1")
    bench.finish()

def test_other():
    pass
""",
        "--junitxml=out.xml",
    ).assert_outcomes(passed=2)
    tests = {case.get("name"): case for case in ElementTree.parse(pytester.path / "out.xml").iter("testcase")}
    found = {p.get("name"): p.get("value") for p in tests["test_it"].iter("property")}
    assert (found["bench.outcome"], found["bench.t_active_s"], found["bench.time"]) == (
        "CD",
        "1.0",
        "virtual",
    )
    assert 0 < float(found["bench.td_s"]) < 0.5
    assert 0 < float(found["bench.worst_step_s"]) < 1e-3
    assert 0 < float(found["bench.bus_load"]) < 0.2
    assert (found["bench.ecu"], found["bench.runs_on"]) == ("ifd", "mcu")
    for name in ("lap", "firmware", "calibration"):
        assert len(found[f"bench.{name}_sha256"]) == 64
    assert not list(tests["test_other"].iter("property"))
