"""A run from a lap to a verdict, on the host core where it is built: all parts together, and the document."""

import json

import pytest

from bench.codec import Codec
from bench.errors import FaultError, LapError
from bench.faults.spec import parse_fault
from bench.laps.lap import Lap
from bench.recorder import record
from bench.run import document, prepare, run_lap
from bench.verdict import Outcome
from targets.emulated import EmulatedEcu
from targets.host import HostEcu, library
from tests.conftest import wavy_lap

NEEDS = ("fork_stroke_mm", "pitch_rate_dps", "speed_kmh", "rear_stroke_mm")


@pytest.fixture
def quiet(calibration):
    """The calibration with a threshold that only a shorted sensor passes: its residual has no bound."""
    return calibration.with_detector(threshold=20.0, multiple=2, warmup=50)


@pytest.fixture
def ecu(image, quiet):
    """A fresh ECU at each call; the emulated MCU where the host core is not built."""

    def power_on(calibration=quiet):
        return HostEcu(calibration) if library() else EmulatedEcu(image, calibration)

    return power_on


def run(ecu, *faults, seconds=3.0, **more):
    return run_lap(wavy_lap(seconds), ecu, [parse_fault(text) for text in faults], NEEDS, **more)


def test_fault_detected(ecu):
    """A shorted sensor is found after n windows above the threshold, counted from when it acted."""
    verdict = run(ecu(), "rear_stroke:short@2").verdict
    assert (verdict.outcome, verdict.t_cmd_ns, verdict.t_active_ns) == (Outcome.CD, 2 * 10**9, 2 * 10**9)
    # n L_s = 40 steps above T on end, the first of them the fault's own cycle, and the way to the bus
    assert 0.390 < verdict.td_ns / 1e9 < 0.393


def test_healthy_lap(ecu):
    """Without a fault there is no alarm, and every cycle is answered."""
    done = run(ecu())
    assert (done.verdict.outcome, done.watch.answered) == (Outcome.OK, 300)


def test_false_alarm(ecu, quiet):
    """A threshold that a healthy lap passes gives a false alarm, with a fault later and without one."""
    nervous = quiet.with_detector(threshold=0.0)
    assert run(ecu(nervous)).verdict.outcome is Outcome.FA
    assert run(ecu(nervous), "rear_stroke:short@2").verdict.outcome is Outcome.FA


def test_missed(ecu):
    """A fault the detector does not see is missed; so is one that it sees too late."""
    assert run(ecu(), "rear_stroke:uncalibration:gain=1.1@2").verdict.outcome is Outcome.MD
    assert run(ecu(), "rear_stroke:short@2", td_max_ns=10**8).verdict.outcome is Outcome.MD


def test_fault_that_never_acts(ecu):
    """A fault that changes no sample makes the run invalid."""
    verdict = run(ecu(), "rear_stroke:uncalibration:gain=1@2").verdict
    assert verdict.outcome is Outcome.INVALID
    assert "never acted" in verdict.reason


def test_wrong_sensor(ecu, quiet):
    """An alarm raised by a fault of an input names the wrong sensor."""
    attentive = quiet.with_detector(threshold=0.45)
    assert run(ecu(attentive)).verdict.outcome is Outcome.OK
    assert run(ecu(attentive), "fork_stroke:open@1").verdict.outcome is Outcome.ID


def test_time_is_the_laps_own(ecu):
    """A lap that does not start at 0 s is run from its own start: faults are timed from there."""
    lap = wavy_lap(3.0)
    later = Lap(lap.t_ns + 7_000_000_000, lap.channels)
    specs = [parse_fault("rear_stroke:short@2")]
    assert run_lap(later, ecu(), specs, NEEDS).verdict == run_lap(lap, ecu(), specs, NEEDS).verdict


@pytest.mark.parametrize("suffix", [".log", ".blf"])
def test_same_run_twice(ecu, tmp_path, suffix):
    """The same run twice gives the same recording, byte for byte."""
    paths = [tmp_path / f"{k}{suffix}" for k in range(2)]
    for path in paths:
        frames = run(ecu(), "rear_stroke:hold@1").ride.frames
        record(path, [(d.t_end_ns, d.frame, d.node) for d in frames])
    assert paths[0].read_bytes() == paths[1].read_bytes()
    assert paths[0].stat().st_size > 1000


def test_same_run_twice_on_the_mcu(image, quiet):
    """The emulated MCU, too, gives the same frames at the same nanoseconds every time."""
    first, second = (run(EmulatedEcu(image, quiet), seconds=1.0).ride for _ in range(2))
    assert first == second


def test_missing_channels(ecu):
    """A lap without channels the ECU needs is refused with their names before anything is ridden."""
    lap = wavy_lap(1.0, names=("fork_stroke_mm", "rear_stroke_mm"))
    with pytest.raises(LapError, match=r"missing pitch_rate_dps, speed_kmh, needed by ecu ifd"):
        run_lap(lap, ecu(), needs=NEEDS)


def test_channel_that_shares_its_message():
    """A channel that is there but whose message lacks another is refused with both names."""
    lap = wavy_lap(1.0, names=("fork_stroke_mm", "pitch_rate_dps", "speed_kmh"))
    with pytest.raises(LapError, match=r"missing rear_stroke_mm: message STROKES is not sent.*fork_stroke"):
        prepare(lap, [], ("fork_stroke_mm",), "somebody", Codec())


@pytest.mark.parametrize("text", ["rear_stroke:open@3", "acc_body:open@1"])
def test_fault_the_lap_cannot_have(ecu, text):
    """A fault after the lap's end, or on a channel it lacks, is refused."""
    lap = wavy_lap(2.0, names=NEEDS)
    with pytest.raises(FaultError):
        run_lap(lap, ecu(), [parse_fault(text)], NEEDS)


def test_document(image, quiet):
    """The document holds, as plain JSON in seconds, what was asked, what acted, what was seen, its cost."""
    done = run(EmulatedEcu(image, quiet), "rear_stroke:short@1+0.5", seconds=2.0)
    result = json.loads(json.dumps(document(done), allow_nan=False))
    assert (result["outcome"], result["t_cmd_s"], result["t_active_s"], result["t_obs_s"]) == ("CD", 1, 1, 1)
    assert result["t_alarm_s"] == pytest.approx(1.391, abs=1e-3)
    assert result["td_s"] == pytest.approx(result["t_alarm_s"] - 1, abs=1e-9)
    assert 1.5 < result["t_heal_s"] < 1.75
    assert result["faults"] == [
        {"spec": "rear_stroke:short:to=gnd@1+0.5", "t_cmd_s": 1, "t_active_s": 1, "t_obs_s": 1}
    ]
    assert result["alarms_s"] == [[result["t_alarm_s"], result["t_heal_s"]]]
    assert (result["input_cycles"], result["answers"], result["simulated_s"]) == (200, 200, 2.01)
    cycles = result["step_cycles"]
    assert 3_000 < cycles["min"] <= cycles["mean"] <= cycles["max"] < 8_000
    bus = result["bus"]
    assert (bus["bitrate"], bus["frames"]) == (500_000, 1000)
    assert bus["bits"] == done.ride.load.bits
    assert 0.05 < bus["load"] < 0.15
    assert list(bus["worst_wait_s"]) == ["0x100", "0x101", "0x102", "0x200", "0x201"]


def test_document_of_a_silent_run(ecu):
    """What did not happen is null, in a healthy run as in one that never began."""

    class Dead:
        name = "ifd"
        advance = receive = sent = lambda self, *_: None
        where = lambda self: ""

    healthy, dead = document(run(ecu(), seconds=1.0)), document(run(Dead(), seconds=1.0))
    for name in ("t_cmd_s", "t_active_s", "t_obs_s", "t_alarm_s", "t_heal_s", "td_s"):
        assert healthy[name] is None
    assert (healthy["faults"], healthy["alarms_s"], healthy["saturated_samples"]) == ([], [], {})
    assert (dead["outcome"], dead["step_cycles"], dead["answers"]) == ("INVALID", None, 0)


def test_document_counts_saturated_samples(ecu):
    """Samples beyond a sensor's span are counted by sensor."""
    lap = wavy_lap(1.0)
    high = Lap(lap.t_ns, {**lap.channels, "fork_stroke_mm": lap.channels["fork_stroke_mm"] + 1000})
    assert document(run_lap(high, ecu(), needs=NEEDS))["saturated_samples"] == {"fork_stroke": 1000}
