"""Firmware held to its reference over a whole lap (section V.5.2, STEP 5): figure V.18.

Belongs here: both predictions of the same frames. Never: a plot, how either of them computes.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.codec import Codec
from bench.laps.lap import Lap
from bench.mdlog.logger import sampled
from bench.rig import ride
from bench.run import prepare
from bench.sensors.parts import Sensors
from bench.watch import STATUS, Watch
from targets.ecu import Ecu, Frame, Transmission
from targets.ecus import Build
from targets.errors import FirmwareError
from targets.narx.reference import parallel, series_parallel

Floats = NDArray[np.float64]

STATE_SYMBOL, PREDICTED_OFFSET = "state", 68
"""Where the firmware keeps its prediction: `predicted_mm` of `ecu` in core/ecu.h."""


@dataclass(frozen=True)
class Deviation:
    """Predictions of one lap, mm (T,) at 100 Hz: the firmware's single-precision ones and the reference's.

    reference_mm: in free run, fed back with its own. step_mm: each step by itself, from what the firmware fed
    back: what its arithmetic adds at once, without what the loop makes of it.
    """

    t_s: Floats
    firmware_mm: Floats
    reference_mm: Floats
    step_mm: Floats

    @property
    def percent(self) -> Floats:
        """Of the reference's free run at each sample, signed."""
        return 100.0 * (self.firmware_mm - self.reference_mm) / self.reference_mm

    @property
    def step_percent(self) -> Floats:
        """Of the reference's single step at each sample, signed."""
        return 100.0 * (self.firmware_mm - self.step_mm) / self.step_mm


class _Listening:
    """An emulated ECU whose prediction is read from its memory whenever it asks to send its status."""

    def __init__(self, ecu: Any, address: int, status: int) -> None:
        self.name, self._ecu, self._address, self._status = ecu.name, ecu, address, status
        self.predicted: list[float] = []

    def advance(self, t_ns: int) -> Transmission | None:
        request: Transmission | None = self._ecu.advance(t_ns)
        if request is not None and request.frame.id == self._status:
            content = self._ecu.mcu.read_bytes(self._address, 4)
            self.predicted.append(float(np.frombuffer(content, dtype="<f4")[0]))
        return request

    def receive(self, frame: Frame, t_ns: int) -> None:
        self._ecu.receive(frame, t_ns)

    def sent(self, handle: int, t_ns: int) -> None:
        self._ecu.sent(handle, t_ns)

    def where(self) -> str:
        return str(self._ecu.where())


def validate(build: Build, lap: Lap, sensors: Sensors) -> Deviation:
    """Ride `lap` on the emulated MCU and let torch predict from the same codes in double precision.

    Raises FirmwareError if the firmware did not answer every cycle, or is not ours.
    """
    codec = Codec()
    sent = prepare(lap, (), build.needs(), f"ecu {build.role}", codec, sensors).now
    ecu: Any = build.power_on()
    if not hasattr(ecu, "mcu"):
        raise FirmwareError("validation reads the memory of the emulated MCU: --on mcu")
    image = ecu.mcu.image
    listening = _Listening(
        ecu, image.symbol(STATE_SYMBOL) + PREDICTED_OFFSET, codec.message(STATUS[build.role]).id
    )
    watch = Watch(codec, build.role)
    as_ecu: Ecu = listening
    done = ride(sent.frames, as_ecu, watch)
    narx = build.calibration.network
    seen = sampled(sent.codes)
    u = np.stack([seen[name] for name in narx.inputs], axis=1)
    if done.failure or len(listening.predicted) != len(u):
        reason = done.failure or f"{len(listening.predicted)} answers to {len(u)} cycles"
        raise FirmwareError(f"the lap was not ridden to its end: {reason}")
    firmware = np.array(listening.predicted)
    # a shifted network's first predictions are for later: until then both publish what they begin with
    ahead, count = np.full(narx.shift, narx.initial_mm), len(u) - narx.shift
    own = np.concatenate([ahead, parallel(narx, u[:count])])
    step = np.concatenate([ahead, series_parallel(narx, u[:count], firmware[narx.shift :])])
    return Deviation(np.arange(len(u)) / 100.0, firmware, own, step)
