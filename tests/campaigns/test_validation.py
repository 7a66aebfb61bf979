"""Firmware against its reference."""

import dataclasses

import numpy as np
import pytest

from bench.sensors.parts import IDEAL
from campaigns import validation
from campaigns.validation import validate
from targets.ecus import build
from targets.errors import FirmwareError
from targets.narx.reference import parallel
from tests.conftest import wavy_lap


@pytest.mark.parametrize("role", ["ifd", "soft_sensor"])
def test_firmware_predicts_what_torch_does(role):
    """Over a lap the firmware's prediction stays within 1e-3 % of torch's, each step within 2e-4 %."""
    found = validate(build(role, "mcu"), wavy_lap(4.0), IDEAL)
    assert len(found.t_s) == 400
    assert 0 < np.abs(found.step_percent).max() < 2e-4
    assert np.abs(found.percent).max() < 1e-3


def test_a_wrong_weight_shows(monkeypatch):
    """A reference whose bias differs by a thousandth shows: the free run deviates by more than rounding."""

    def spoiled(narx, u):
        return parallel(dataclasses.replace(narx, b2=narx.b2 + 1e-3), u)

    monkeypatch.setattr(validation, "parallel", spoiled)
    found = validate(build("ifd", "mcu"), wavy_lap(2.0), IDEAL)
    assert np.abs(found.percent).max() > 1e-2
    assert np.abs(found.step_percent).max() < 2e-4


def test_the_host_has_no_memory_to_read():
    """Validation of another host than the emulated MCU is refused."""
    from targets.host import library

    if not library():
        pytest.skip("no host core: no C compiler at install")
    with pytest.raises(FirmwareError, match="reads the memory of the emulated MCU"):
        validate(build("ifd", "host"), wavy_lap(1.0), IDEAL)
