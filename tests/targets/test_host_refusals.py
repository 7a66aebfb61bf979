"""What either host refuses: an image without room, calibration data that the core does not pass, no core."""

from dataclasses import replace

import pytest

from targets.emulated import EmulatedEcu
from targets.errors import CalibrationError, FirmwareError
from targets.host import HostEcu


@pytest.mark.parametrize(
    ("symbols", "error", "says"),
    [
        (
            {"calibration_room": 100},
            CalibrationError,
            r"image of \d+ bytes exceeds .* section of 100",
        ),
        ({"calibration_image": 0x20000000}, FirmwareError, "symbol calibration_image lies outside flash"),
        ({"calibration_image": 0x080FFFF0}, FirmwareError, "symbol calibration_image lies outside flash"),
        ({"calibration_image": None}, FirmwareError, "no symbol calibration_image"),
        ({"calibration_room": None}, FirmwareError, "no symbol calibration_room"),
    ],
)
def test_image_without_room_for_the_calibration(image, calibration, symbols, error, says):
    """An image that has no place, or too small a one, for the calibration is refused."""
    changed = {name: at for name, at in {**image.symbols, **symbols}.items() if at is not None}
    with pytest.raises(error, match=says):
        EmulatedEcu(replace(image, symbols=changed), calibration)


def test_host_core_refuses_what_the_firmware_refuses(host_ecu):
    """Calibration data that the core's own check does not pass is refused with the check's number."""

    class Erased:
        def image(self):
            return b"\xff" * 100

    with pytest.raises(FirmwareError, match=r"refuses the calibration \(fault 1\)"):
        HostEcu(Erased())


def test_host_core_that_was_not_built(monkeypatch, calibration):
    """Without the host core the line says what to install."""
    monkeypatch.setattr("targets.host.library", lambda: None)
    with pytest.raises(FirmwareError, match="not built: install a C compiler and strokebench again"):
        HostEcu(calibration)
