"""The ECU on the emulated STM32F405: a real ELF, its calibration in flash, its bxCAN on the bus."""

from typing import Any, NoReturn

import numpy as np

from targets.calibration import Calibration
from targets.ecu import Frame, Transmission
from targets.errors import CalibrationError, FirmwareError, FirmwareFault
from targets.firmware import clock
from targets.mcu import bxcan, state
from targets.mcu.image import FLASH, Image
from targets.mcu.machine import TRANSMIT, Stm32f405

CALIBRATION_SYMBOL, ROOM_SYMBOL = "calibration_image", "calibration_room"


class EmulatedEcu:
    """`image` with `calibration` on the MCU, powered at `power_on_ns`, on a bus of `bitrate` bit/s.

    calibration: None for a firmware that has no section for it. clock_hz: the CPU's clock, in place of the
    image's. mcu: the machine itself, to look into and to tamper with.
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
    ) -> None:
        self.name = name
        self.mcu = Stm32f405(image, power_on_ns)
        self._bitrate = bitrate
        self._waiting: list[Transmission] = []
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

    def advance(self, t_ns: int) -> Transmission | None:
        """Run the firmware until `t_ns` or its next transmit request; None also at a breakpoint."""
        if not self._waiting:
            if self.mcu.run(t_ns) != TRANSMIT:
                return None
            self._collect()
        # A request made in the last basic block may lie past t_ns: it waits for its turn.
        return self._waiting.pop(0) if self._waiting[0].t_ns <= t_ns else None

    def receive(self, frame: Frame, t_ns: int) -> None:
        """The frame's last bit was seen on the bus at `t_ns`."""
        S = self.mcu.state
        low, high = int.from_bytes(frame.data[:4], "little"), int.from_bytes(frame.data[4:], "little")
        rir = frame.id << 3 | 4 if frame.extended else frame.id << 21
        if not bxcan.receive(S, self._bitrate, rir, len(frame.data), low, high):
            self._wrong_rate()

    def sent(self, handle: int, t_ns: int) -> None:
        """The frame in mailbox `handle` was sent."""
        bxcan.sent(self.mcu.state, handle)

    def where(self) -> str:
        """The program counter and the function it is in."""
        return self.mcu.where()

    def _collect(self) -> None:
        S: Any = self.mcu.state
        if bxcan.off_rate(S, self._bitrate):
            self._wrong_rate()
        requested = int(S[state.CAN_TX_NEW])
        S[state.CAN_TX_NEW] = 0
        for mailbox in range(3):
            if requested >> mailbox & 1:
                tir, tdtr, low, high = state.words(S, state.CAN_MAILBOX + 4 * mailbox, 4)
                data = low.to_bytes(4, "little") + high.to_bytes(4, "little")
                extended = bool(tir & 4)
                frame = Frame(tir >> 3 if extended else tir >> 21, data[: min(tdtr & 15, 8)], extended)
                self._waiting.append(Transmission(int(S[state.CAN_TX_NS + mailbox]), mailbox, frame))
        self._waiting.sort(key=lambda transmission: transmission.t_ns)

    def _wrong_rate(self) -> NoReturn:
        raise FirmwareFault(
            f"bxCAN is set to {bxcan.bitrate(self.mcu.state)} bit/s on a bus of {self._bitrate} bit/s, "
            f"{self.mcu.where()}"
        )
