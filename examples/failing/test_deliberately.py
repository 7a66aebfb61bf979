"""A test that fails, to show what a failure looks like: no fault of this kind is found in so short a time.

pytest failing/test_deliberately.py
"""

import pytest


@pytest.mark.lap(route="test_lap", seed=7, seconds=20)
@pytest.mark.ecu("ifd", model="gsxr1000_checks")
def test_frozen_sensor_is_found_at_once(bench, ecu, faults):
    """Demands an alarm 100 ms after the sensor froze; the check for it needs 14 equal samples, 140 ms."""
    bench.ride(8)
    fired = faults.fire("rear_stroke:hold")
    ecu.alarm.within(0.1, of=fired)
