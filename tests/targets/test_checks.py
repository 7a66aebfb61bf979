"""The second detector: what each check finds and names, and that the firmware does the same."""

from dataclasses import replace

import numpy as np
import pytest

from bench.codec import Codec
from bench.faults.insertion import insert
from bench.faults.spec import parse_fault
from bench.mdlog.logger import sampled, schedule
from bench.plant.motorcycle import load_motorcycle
from bench.plant.ride import ride as simulate
from bench.plant.route import load_route
from bench.rig import ride
from bench.sensors.codes import acquire
from bench.sensors.datasheets import load_sensors
from bench.watch import Watch
from targets.calibration import load
from targets.checks import KINDS, findings, first_alarm
from targets.detector import Checks
from targets.ecus import DEFAULT_CALIBRATION
from targets.emulated import EmulatedEcu
from targets.firmware import ELF
from targets.host import HostEcu, library
from targets.mcu.image import load as load_image

CODEC = Codec()
CHECKS = Checks(hold_ratio=0.17, loss_threshold=0.08)
FAULTS = {
    "open": "rear_stroke:open@8",
    "short": "rear_stroke:short@8",
    "hold": "rear_stroke:hold@8",
    "hold in noise": "rear_stroke:hold:noise=2@8",
    "gain": "rear_stroke:uncalibration:gain=1.2@8",
    "offset": "rear_stroke:offset:by=-9@8",
}
NAMED = {"hold in noise": "hold", "gain": "uncalibration", "offset": "uncalibration"}


@pytest.fixture(scope="module")
def network():
    return load(DEFAULT_CALIBRATION).network


@pytest.fixture(scope="module")
def codes():
    """Fifteen seconds of a simulated ride, through the sensors."""
    lap = simulate(load_route("mixed_5km"), load_motorcycle("gsxr1000"), 77, 15.0)
    return acquire(lap, load_sensors("datasheet"), 77)


def strokes(codes, network, *faults):
    """Predicted and measured stroke at 100 Hz under faults."""
    seen = sampled(insert(codes, [parse_fault(text) for text in faults])[0], 100)
    return network.free_run(np.stack([seen[name] for name in network.inputs], axis=1)), seen["rear_stroke_mm"]


def test_kinds_are_those_of_the_bus():
    """A kind has one name and number: here, on the bus, and where the bench says what is right."""
    numbers = CODEC.message("IFD_STATUS").signals["kind"].names
    assert numbers == dict(enumerate(KINDS))
    expected = {parse_fault(text).called for text in (*FAULTS.values(), "rear_stroke:short:to=batt@8")}
    assert expected == set(KINDS[1:])


@pytest.mark.parametrize("fault", FAULTS)
def test_each_fault_is_found_and_named(codes, network, fault):
    """Every kind of fault is found within 2.5 s of its start, not before, and named."""
    found = findings(*strokes(codes, network, FAULTS[fault]), CHECKS)
    at = int(found.alarm.argmax())
    assert 800 <= at <= 1050
    assert KINDS[found.kind[at]] == NAMED.get(fault, fault)


def test_rails_are_found_at_once(codes, network):
    """An open or shorted sensor is found within 50 ms."""
    for fault in ("open", "short"):
        found = findings(*strokes(codes, network, FAULTS[fault]), CHECKS)
        assert found.alarm.argmax() - 800 <= 5


def test_healthy_ride_is_quiet(codes, network):
    """Nothing is found where nothing is wrong."""
    assert not findings(*strokes(codes, network), CHECKS).alarm.any()


@pytest.mark.parametrize("where", ["mcu", "host"])
@pytest.mark.parametrize("fault", [*FAULTS, "healed"])
def test_firmware_does_what_the_reference_does(codes, network, where, fault):
    """Alarm and kind of every answer on the bus are those of the reference, the loss to single precision."""
    if where == "host" and library() is None:
        pytest.skip("the host core is not built: no C compiler was found at installation")
    text = FAULTS.get(fault, "rear_stroke:short@8+1")
    calibration = replace(load(DEFAULT_CALIBRATION), detector=CHECKS)
    ecu = HostEcu(calibration) if where == "host" else EmulatedEcu(load_image(ELF["ifd"]), calibration)
    faulty = insert(codes, [parse_fault(text)])[0]
    done = ride(schedule(faulty, CODEC), ecu, Watch(CODEC), 500_000)
    status = CODEC.message("IFD_STATUS").id
    payload = b"".join(d.frame.data for d in done.frames if d.frame.id == status)
    said = CODEC.decode_all("IFD_STATUS", np.frombuffer(payload, np.uint8).reshape(-1, 8))
    expected = findings(*strokes(codes, network, text), CHECKS)
    np.testing.assert_array_equal(said["alarm"], expected.alarm)
    np.testing.assert_array_equal(said["kind"], expected.kind)
    np.testing.assert_allclose(said["residual_pct"], 100 * expected.loss, rtol=0, atol=0.006)
    if fault == "healed":
        assert np.count_nonzero(np.diff(said["alarm"].astype(int))) == 2


def test_no_alarm_while_warming_up(codes, network):
    """A fault from the start raises no alarm before the warm-up is over."""
    found = findings(*strokes(codes, network, "rear_stroke:open@0"), CHECKS)
    assert int(found.alarm.argmax()) == CHECKS.warmup


@pytest.mark.parametrize("begin", [0, 300, 799, 800, 801])
@pytest.mark.parametrize("fault", ["short", "hold", "gain"])
def test_first_alarm_from_anywhere(codes, network, fault, begin):
    """Looking from a sample on finds the alarm that the whole ride has."""
    predicted, measured = strokes(codes, network, FAULTS[fault])
    found = findings(predicted, measured, CHECKS)
    at = int(found.alarm.argmax())
    assert first_alarm(predicted, measured, begin, CHECKS) == (at, KINDS[found.kind[at]])


def test_stop_that_is_expected():
    """A suspension at its stop, where the prediction has it, is neither an open nor a shorted sensor."""
    measured = np.full(400, 110.0)
    assert not findings(np.full(400, 104.0), measured, Checks(loss_threshold=0.2)).alarm.any()
    assert findings(np.full(400, 60.0), measured, Checks(loss_threshold=0.2)).alarm.any()


def test_standing_still():
    """A code that repeats while the prediction stands still, too, is no held sensor."""
    assert not findings(np.full(1000, 40.0), np.full(1000, 40.2), Checks()).alarm.any()
