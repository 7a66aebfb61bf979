"""The verdict: each outcome from what was seen on the bus and what the rig knows, and which of them wins."""

import pytest

from bench.codec import Codec
from bench.faults.insertion import Insertion
from bench.faults.spec import parse_fault
from bench.verdict import TD_MAX_NS, Outcome, judge
from bench.watch import Alarm, Watch

S = 1_000_000_000


def watch(*alarms, **counts):
    seen = Watch(Codec())
    seen.alarms.extend(Alarm(*alarm) for alarm in alarms)
    for name, value in counts.items():
        setattr(seen, name, value)
    return seen


def fault(text="rear_stroke:open@5", active_s=5.0, obs_s=5.25):
    spec = parse_fault(text)
    active, obs = (None if t is None else round(t * S) for t in (active_s, obs_s))
    return Insertion(spec, spec.t_cmd_ns, active, obs)


def test_correct_detection():
    """An alarm after the fault acted is a correct detection, its time counted from when the fault acted."""
    verdict = judge(watch((7 * S, None)), [fault(active_s=5.5)])
    assert verdict.outcome is Outcome.CD
    assert (verdict.t_cmd_ns, verdict.t_active_ns, verdict.t_obs_ns) == (5 * S, 5_500_000_000, 5_250_000_000)
    assert (verdict.t_alarm_ns, verdict.t_heal_ns, verdict.td_ns) == (7 * S, None, 1_500_000_000)
    assert verdict.reason == "alarm 1.500 s after the fault acted"


def test_alarm_taken_back():
    """An alarm that was taken back is still the detection; the verdict says when it healed."""
    verdict = judge(watch((7 * S, 8 * S), (9 * S, None)), [fault()])
    assert (verdict.outcome, verdict.t_alarm_ns, verdict.t_heal_ns) == (Outcome.CD, 7 * S, 8 * S)


@pytest.mark.parametrize("alarm_ns", [5 * S, 5 * S + TD_MAX_NS])
def test_detection_at_the_edges_of_its_time(alarm_ns):
    """An alarm in the instant the fault acts, and one exactly at the latest time, are detections."""
    assert judge(watch((alarm_ns, None)), [fault()]).outcome is Outcome.CD


def test_missed_for_good():
    """No alarm at all is a missed detection without a time."""
    verdict = judge(watch(), [fault()])
    assert (verdict.outcome, verdict.td_ns, verdict.t_alarm_ns) == (Outcome.MD, None, None)
    assert verdict.reason == "no alarm after rear_stroke:open@5"


def test_missed_because_late():
    """An alarm later than the latest time is a missed detection, and its time enters no average."""
    verdict = judge(watch((5 * S + TD_MAX_NS + 1, None)), [fault()])
    assert (verdict.outcome, verdict.td_ns) == (Outcome.MD, None)
    assert "120.000 s after the fault, later than 120.000 s" in verdict.reason


def test_latest_time_may_be_set():
    """Another latest time than section V.3's is taken at its word."""
    assert judge(watch((7 * S, None)), [fault()], td_max_ns=2 * S).outcome is Outcome.CD
    assert judge(watch((7 * S, None)), [fault()], td_max_ns=2 * S - 1).outcome is Outcome.MD


def test_false_alarm_without_a_fault():
    """An alarm on a healthy lap is a false one."""
    verdict = judge(watch((7 * S, None)), [])
    assert (verdict.outcome, verdict.t_active_ns, verdict.td_ns) == (Outcome.FA, None, None)
    assert verdict.reason == "alarm at 7.000 s without a fault"


def test_false_alarm_before_the_fault():
    """An alarm before the fault acts is a false one, although another follows the fault."""
    verdict = judge(watch((4 * S, 4_500_000_000), (6 * S, None)), [fault()])
    assert (verdict.outcome, verdict.td_ns) == (Outcome.FA, None)
    assert verdict.reason == "alarm at 4.000 s, before the fault acted at 5.000 s"


def test_false_alarm_after_the_fault_has_passed():
    """An alarm when the fault has ended is a false one; the last instant of the fault still counts."""
    passing = fault("rear_stroke:open@5+2")
    assert judge(watch((7 * S, None)), [passing]).outcome is Outcome.FA
    assert judge(watch((7 * S - 1, None)), [passing]).outcome is Outcome.CD


def test_wrong_sensor_named():
    """An alarm in time for a fault of another sensor names the wrong one."""
    verdict = judge(watch((7 * S, None)), [fault("fork_stroke:open@5")])
    assert (verdict.outcome, verdict.td_ns) == (Outcome.ID, None)
    assert verdict.reason == "the alarm names rear_stroke, the fault was on fork_stroke"


def test_healthy_lap():
    """No fault and no alarm is OK."""
    assert judge(watch(), []).outcome is Outcome.OK


def test_first_fault_to_act_is_the_one_to_detect():
    """Of several faults the first to act is judged, whatever the order they were given in."""
    later, sooner, never = fault(active_s=9.0), fault("rear_stroke:hold@5"), fault(active_s=None)
    verdict = judge(watch((7 * S, None)), [never, later, sooner])
    assert (verdict.outcome, verdict.td_ns) == (Outcome.CD, 2 * S)


INVALID = {
    "overrun": (watch, {"overruns": 2}, "ECU overrun: 2 input cycles waited for the step before"),
    "lost": (watch, {"missed_inputs": 3}, "frames lost: the ECU missed 3 input cycles"),
    "garbled": (watch, {"garbled": "IFD_STATUS of 3 bytes"}, "unreadable answer: IFD_STATUS of 3 bytes"),
}


@pytest.mark.parametrize(("make", "counts", "reason"), INVALID.values(), ids=INVALID)
def test_run_that_proves_nothing(make, counts, reason):
    """Lost frames, overruns and unreadable answers make a run invalid, even one with a timely alarm."""
    verdict = judge(make((7 * S, None), **counts), [fault()])
    assert (verdict.outcome, verdict.reason, verdict.td_ns) == (Outcome.INVALID, reason, None)


def test_fault_that_never_acted():
    """A fault that changed no sample proves nothing, alarm or not."""
    never = fault(active_s=None, obs_s=None)
    assert judge(watch(), [never]).outcome is Outcome.INVALID
    verdict = judge(watch((7 * S, None)), [never])
    assert verdict.reason == "the fault rear_stroke:open@5 never acted: every sample is as without it"


def test_rig_that_gave_up():
    """What stopped the rig is the reason, before anything else that was wrong."""
    verdict = judge(watch(missed_inputs=1), [fault(active_s=None)], "the replay was late by 12.0 ms")
    assert (verdict.outcome, verdict.reason) == (Outcome.INVALID, "the replay was late by 12.0 ms")


def test_only_a_found_fault_or_a_quiet_healthy_lap_passes():
    """CD and OK pass; nothing else does."""
    assert [outcome for outcome in Outcome if outcome.passed] == [Outcome.CD, Outcome.OK]


def test_wrong_kind_named():
    """An alarm in time that names another kind of fault is no correct detection; the name is kept."""
    verdict = judge(watch((7 * S, None, "hold")), [fault()])
    assert (verdict.outcome, verdict.named, verdict.td_ns) == (Outcome.ID, "hold", None)
    assert verdict.reason == "the alarm 2.000 s after the fault names hold, it was open"


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("rear_stroke:open@5", "open"),
        ("rear_stroke:short@5", "short"),
        ("rear_stroke:short:to=batt@5", "open"),
        ("rear_stroke:offset@5", "uncalibration"),
    ],
)
def test_right_kind_named(text, named):
    """An alarm that names the kind is a correct detection; full scale is open, whatever made it."""
    assert judge(watch((7 * S, None, named)), [fault(text)]).outcome is Outcome.CD
