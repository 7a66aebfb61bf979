"""The ECU on the emulated STM32F405: a real ELF, its calibration in flash, its bxCAN on the bus."""

import numpy as np

from targets.calibration import Calibration
from targets.can_port import CanPort
from targets.ecu import Transmission
from targets.errors import CalibrationError, FirmwareError
from targets.firmware import clock
from targets.mcu.image import FLASH, Image
from targets.mcu.machine import TRANSMIT, Stm32f405

CALIBRATION_SYMBOL, ROOM_SYMBOL = "calibration_image", "calibration_room"


class EmulatedEcu(CanPort):
    """`image` with `calibration` on the MCU, powered at `power_on_ns`, on a bus of `bitrate` bit/s.

    calibration: None for a firmware that has no section for it. clock_hz: the CPU's clock, in place of the
    image's. controller: which bxCAN is on that bus, 1 or 2; `port` puts the other one on another.
    mcu: the machine itself, to look into and to tamper with.
    Raises CalibrationError if the image's calibration section is too small, FirmwareError if it has none,
    TargetError for a clock that cannot be set.
    """

    def __init__(
        self,
        image: Image,
        calibration: Calibration | None,
        name: str = "ifd",
        power_on_ns: int = -100_000_000,
        bitrate: int = 500_000,
        clock_hz: int | None = None,
        controller: int = 1,
    ) -> None:
        super().__init__(Stm32f405(image, power_on_ns), controller, bitrate)
        self.name = name
        self._ports: list[CanPort] = [self]
        if calibration:
            self._calibrate(image, calibration)
        if clock_hz is not None:
            self.mcu.patch(image.symbol(clock.SYMBOL), clock.setting(clock_hz, bitrate).content())

    def _calibrate(self, image: Image, calibration: Calibration) -> None:
        content = calibration.image()
        room = image.symbol(ROOM_SYMBOL)
        if len(content) > room:
            raise CalibrationError(f"image of {len(content)} bytes exceeds the firmware's section of {room}")
        self.calibration_at = image.symbol(CALIBRATION_SYMBOL) - FLASH
        if not 0 <= self.calibration_at <= len(self.mcu.flash) - len(content):
            raise FirmwareError(f"{image.source}: symbol {CALIBRATION_SYMBOL} lies outside flash")
        self.mcu.flash[self.calibration_at :][: len(content)] = np.frombuffer(content, dtype=np.uint8)

    def port(self, controller: int, bitrate: int) -> CanPort:
        """Put the other controller on a bus: `advance` runs it along, its `request` says what it sends."""
        self._ports.append(CanPort(self.mcu, controller, bitrate))
        return self._ports[-1]

    def advance(self, t_ns: int) -> Transmission | None:
        """Run the firmware until `t_ns` or its next transmit request; None also at a breakpoint."""
        request = self.request(t_ns)
        while request is None and self.mcu.run(t_ns) == TRANSMIT:
            for port in self._ports:
                port.collect()
            request = self.request(t_ns)
        return request
