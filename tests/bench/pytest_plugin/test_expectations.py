"""What a suite can expect of ECU, alarm and signals, and the line that it gets where that fails."""

import re

import pytest

SHORT = 'faults.fire("rear_stroke:short")'


def failed(result, count=1):
    """The lines of a run's failures, one a test."""
    result.assert_outcomes(failed=count)
    lines = [line.partition("Unmet: ")[2] for line in result.outlines if line.startswith("E ")]
    assert len(lines) == count
    return lines


def test_alarm_in_time(suite):
    """An alarm that comes by its deadline passes, with the instant it has on the bus; bench time is there."""
    suite("""
def test_it(bench, ecu, faults):
    bench.ride(1)
    fault = faults.fire("rear_stroke:short")
    assert (bench.now, fault.t_active, fault.state) == (1.0, 1.001, "fired")
    assert ecu.alarm.within(0.5)
    assert ecu.alarm.up
    assert 1.001 < ecu.alarm.t <= bench.now < ecu.alarm.t + 0.01
    assert fault.state == "active"
    assert bench.verdict.td_ns == round((ecu.alarm.t - fault.t_active) * 1e9)
""").assert_outcomes(passed=1)


def test_alarm_too_late(suite):
    """Without an alarm by the deadline the bench stands at the deadline, and the line has every instant."""
    (line,) = failed(
        suite(f"""
def test_it(bench, ecu, faults):
    bench.ride(1)
    {SHORT}
    try:
        ecu.alarm.within(0.05)
    finally:
        assert bench.now == 1.05
""")
    )
    assert re.fullmatch(
        r"expected alarm within 0\.05 s; seen: no alarm, residual [0-9.]+ % at 1\.041 s "
        r"\(t_cmd 1\.000 s, t_active 1\.001 s, t_obs 1\.001 s, deadline 1\.050 s\)",
        line,
    )


def test_deadline_of_a_fault(suite):
    """A deadline counted from a fault's first wrong sample is met or missed by its time to detect alone."""
    result = suite("""
@pytest.mark.parametrize("more", [1e-6, -1e-6])
def test_it(bench, ecu, faults, more):
    fault = faults.plan("rear_stroke:short@1.2")
    bench.ride(2.5)
    ecu.alarm.within(ecu.alarm.t - fault.t_active + more, of=fault)
""")
    result.assert_outcomes(passed=1, failed=1)
    result.stdout.fnmatch_lines(
        ["E *expected alarm within * s of rear_stroke:short:to=gnd@1.2; seen: alarm at 1.*"]
    )


def test_fault_that_never_acts(suite):
    """Of a fault that changes no sample no detection can be expected, and the line says so."""
    (line,) = failed(
        suite("""
def test_it(bench, ecu, faults):
    fault = faults.plan("rear_stroke:uncalibration:gain=1@1")
    ecu.alarm.within(0.5, of=fault)
""")
    )
    assert line.endswith("seen: rear_stroke:uncalibration:gain=1@1 never acts: every sample is as without it")


def test_earlier_alarm_is_no_answer(suite):
    """An alarm that was up before is no answer to what comes now."""
    (line,) = failed(
        suite(f"""
def test_it(bench, ecu, faults):
    bench.ride(1)
    {SHORT}
    ecu.alarm.within(0.5)
    bench.ride(0.5)
    ecu.alarm.within(0.5)
""")
    )
    assert line.startswith("expected alarm within 0.5 s; seen: alarm at 1.")


def test_deadline_beyond_the_lap(suite):
    """What has not come by the lap's end is not said to be missing by a deadline after it."""
    (line,) = failed(
        suite("""
def test_it(bench, ecu):
    bench.ride(2.5)
    ecu.alarm.within(2)
""")
    )
    assert line == (
        "expected alarm within 2 s; seen: the lap's end at 3.010 s before that (deadline 4.500 s)"
    )


def test_absence(suite):
    """The time without an alarm is ridden; one that comes in it is reported with its instant."""
    result = suite(f"""
def test_none(bench, ecu):
    assert ecu.alarm.absent_for(2)
    assert bench.now == 2.0

def test_one(bench, ecu, faults):
    bench.ride(1)
    {SHORT}
    ecu.alarm.absent_for(1)

def test_up_already(bench, ecu, faults):
    bench.ride(1)
    {SHORT}
    bench.ride(0.5)
    ecu.alarm.absent_for(0.1)

def test_beyond(bench, ecu):
    ecu.alarm.absent_for(4)
""")
    result.assert_outcomes(passed=1, failed=3)
    result.stdout.fnmatch_lines_random(
        [
            "*expected no alarm for 1 s; seen: alarm at 1.*",
            "*expected no alarm for 0.1 s; seen: alarm at 1.*",
            "*expected no alarm for 4 s; seen: the lap's end at 3.010 s before that*",
        ]
    )


def test_healing(suite):
    """An alarm is taken back after its fault is cleared; one that stays up is reported."""
    result = suite(f"""
def test_heals(bench, ecu, faults):
    bench.ride(1)
    fault = {SHORT}
    ecu.alarm.within(0.5)
    fault.clear()
    assert not ecu.alarm.cleared.within(1).up
    assert fault.state == "cleared"
    assert fault.t_end == pytest.approx(ecu.alarm.t, abs=0.01)

def test_stays(bench, ecu, faults):
    bench.ride(1)
    {SHORT}
    ecu.alarm.within(0.5)
    ecu.alarm.cleared.within(0.2)

def test_never_was(bench, ecu):
    ecu.alarm.cleared.within(0.2)
""")
    result.assert_outcomes(passed=1, failed=2)
    result.stdout.fnmatch_lines_random(
        [
            "*expected alarm cleared within 0.2 s; seen: alarm at 1.*deadline 1.*",
            "*expected alarm cleared within 0.2 s; seen: no alarm at all*",
        ]
    )


def test_kind(suite):
    """What the alarm names is there, and is what the fault is called."""
    head = """
import pytest
pytestmark = pytest.mark.ecu(model="gsxr1000_checks")
"""
    suite(
        """
@pytest.mark.lap(seed=7, seconds=3.0)
def test_it(bench, ecu, faults):
    assert ecu.alarm.kind is None
    assert ecu.alarm.t is None
    bench.ride(2.5)
    fault = faults.fire("rear_stroke:open")
    assert ecu.alarm.within(0.3).kind == fault.spec.called == "open"
""",
        head=head,
    ).assert_outcomes(passed=1)


def test_step_time(suite):
    """The worst step is in seconds of the firmware's own clock, and a limit below it is not kept."""
    (line,) = failed(
        suite("""
def test_it(bench, ecu):
    assert ecu.step_time.worst is None
    bench.ride(1)
    assert ecu.step_time.worst == max(bench.watch.step_cycles) / 22e6
    ecu.step_time.below(1e-3)
    ecu.step_time.below(1e-6)
""")
    )
    assert re.fullmatch(r"expected every step below 1 us; seen: [0-9.]+ us in step \d+, at 22 MHz.*", line)


@pytest.mark.parametrize(
    ("ask", "said"),
    [
        ("near(20.0, 0.5)", "near"),
        ("below(2.0)", "IFD_STATUS.step below 2; seen: 2 at 0.011 s; 99 of 100 frames are not"),
        ("stays_within(51, 49.5)", "within 49.5 of 51; seen: 1 at 0.001 s against 51; 1 of 100"),
        ("stays_within(50, 40, share=0.9)", "for 90 % of 100 frames"),
    ],
)
def test_signal(suite, ask, said):
    """An expectation of a signal names the first value that disappoints, its instant, and how many do."""
    said = "IFD_STATUS.step 20 ± 0.5; seen: 100 at 0.991 s" if said == "near" else said
    (line,) = failed(
        suite(f"""
def test_it(bench, bus):
    bench.ride_to(0.995)
    bus.signal("IFD_STATUS.step").near(100, 0.0).below(101).above(0).stays_within(50, 50)
    bus.signal("IFD_STATUS.step").stays_within(50, 40, share=0.8).{ask}
""")
    )
    assert said in line


def test_signal_against_the_lap(suite):
    """A measured stroke is the lap's within a bit, at the instants of its frames; another signal is held."""
    suite("""
def test_it(bench, bus, lap):
    bench.ride(2)
    stroke = bus.signal("STROKES.rear_stroke_mm")
    stroke.stays_within("rear_stroke_mm", 2.0)
    assert stroke.at(1.0) == stroke.values[99]  # sent at 1.0 s, it ends later
    stroke.between(1.0, 1.5).stays_within(stroke, 0.0)
    assert len(stroke.between(1.0, 1.5).values) == 50
    assert bus.signal("IFD_STATUS.step").unit == ""
    assert 0.05 < bus.load < 0.2
    with pytest.raises(AssertionError, match="none by 2.000 s"):
        bus.signal("SOFT_STROKE.predicted_mm").near(1, 1)
""").assert_outcomes(passed=1)
