"""An acceptance suite for the IFD, the detector of instrument faults: copy it and put in your own limits.

pytest test_ifd.py                                                     in virtual time, on the emulated MCU
pytest test_ifd.py --bench-ecu=host                                    in virtual time, on this machine
pytest test_ifd.py --bench-bus socketcan:vcan0                         in wall time, ECU in a process beside
pytest test_ifd.py --bench-bus socketcan:can0 --bench-ecu=real         in wall time, your ECU on can0
"""

import pytest

pytestmark = [
    pytest.mark.lap(route="test_lap", motorcycle="gsxr1000", seed=7, seconds=20),
    pytest.mark.ecu("ifd", model="gsxr1000_checks"),
]

LIMITS_S = {
    "rear_stroke:open": 0.1,
    "rear_stroke:short": 0.1,
    "rear_stroke:hold": 0.5,
    "rear_stroke:uncalibration:gain=1.3": 0.5,
}
"""Fault -> the time within which the IFD has to find it."""


def test_healthy_lap_raises_no_alarm(bench, ecu):
    """Without a fault there is no alarm from the lap's start to its end."""
    assert ecu.alarm.absent_for(bench.end - bench.now)
    assert bench.finish().outcome == "OK"


@pytest.mark.parametrize(("fault", "limit_s"), LIMITS_S.items(), ids=str)
def test_fault_is_found_and_named(bench, ecu, faults, fault, limit_s):
    """Each fault raises the alarm within its limit, counted from the first wrong sample, and by its name."""
    bench.ride(8)
    fired = faults.fire(fault)
    ecu.alarm.within(limit_s, of=fired)
    assert ecu.alarm.kind == fired.spec.called


def test_alarm_ends_after_the_fault(bench, ecu, faults):
    """Once the sensor is well again, the alarm is taken back."""
    bench.ride(8)
    faults.fire("rear_stroke:open")
    ecu.alarm.within(0.1)
    faults.clear()
    ecu.alarm.cleared.within(2.0)
    assert ecu.alarm.absent_for(3.0)


def test_planned_fault(bench, ecu, faults):
    """A fault can be planned for an instant, here for 2 s from 10 s on."""
    planned = faults.plan("rear_stroke:short@10+2")
    bench.ride_to(10.0)
    assert not ecu.alarm.up
    ecu.alarm.within(0.1, of=planned)
    assert bench.finish().outcome == "CD"


def test_prediction_follows_the_stroke(bench, bus):
    """Once warm, the soft sensor's stroke is within 5 mm of the measured one for 99 % of the lap."""
    bench.finish()
    predicted = bus.signal("IFD_STATUS.predicted_mm").between(2.0)
    predicted.stays_within(bus.signal("STROKES.rear_stroke_mm"), 5.0, share=0.99)
    bus.signal("IFD_STATUS.residual_pct").between(2.0).below(7.4)


def test_step_time(bench, ecu, bus):
    """A step takes less than a millisecond, and the bus is far from full."""
    bench.ride(10)
    ecu.step_time.below(1e-3)
    assert bus.load < 0.3
