"""Pulses on the step pin and calls of a function, timed from outside the firmware."""

import numpy as np
import pytest

from bench.codec import Codec
from bench.mdlog.logger import schedule
from bench.rig import ride
from bench.sensors.codes import acquire
from bench.watch import Watch
from targets.errors import FirmwareError
from targets.oscilloscope import Oscilloscope, Stopwatch
from tests.conftest import wavy_lap


def ridden(ecu, seconds=0.3):
    """The watch after a short lap."""
    watch = Watch(Codec())
    assert ride(schedule(acquire(wavy_lap(seconds)), watch.codec), ecu, watch).failure is None
    return watch


def test_a_pulse_is_a_step(mcu_ecu):
    """The pin is high for what the firmware counts itself, and the few cycles of counting."""
    probe = Oscilloscope(mcu_ecu.mcu)
    counted = np.array(ridden(mcu_ecu).step_cycles)
    pulses = probe.pulses()
    assert pulses.shape == (30, 3)
    more = pulses[:, 0] - counted
    assert (more > 0).all()
    assert (more < 40).all()
    assert np.ptp(more) <= 4


def test_another_pin_stays_low(mcu_ecu):
    """A pin that the firmware does not drive shows nothing."""
    probe = Oscilloscope(mcu_ecu.mcu, pin=3)
    ridden(mcu_ecu)
    assert probe.pulses().shape == (0, 3)


def test_calls_lie_within_the_pulse(mcu_ecu):
    """A call of the soft sensor takes most of a step, and less than all of it."""
    probe, watch = Oscilloscope(mcu_ecu.mcu), Stopwatch(mcu_ecu.mcu, "narx_step")
    ridden(mcu_ecu)
    calls, pulses = watch.calls(), probe.pulses()[:, 0]
    assert len(calls) == len(pulses) == 30
    assert (calls < pulses).all()
    assert (calls > 0.8 * pulses).all()


def test_function_that_is_not_there(mcu_ecu):
    """A name that the image does not have is refused."""
    with pytest.raises(FirmwareError, match="no symbol lstm_step"):
        Stopwatch(mcu_ecu.mcu, "lstm_step")
