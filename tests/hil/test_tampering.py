"""The firmware under the rig is executed: tampering with its flash while it rides shows on the bus."""

import numpy as np
import pytest

from bench.run import run_lap
from bench.verdict import Outcome
from targets.ecu import Frame
from tests.conftest import network, wavy_lap

STATUS = 0x200
MS = 1_000_000


class Tampered:
    """An ECU to which `act` happens, once, when its `at_ns` has come."""

    def __init__(self, ecu, at_ns: int, act) -> None:
        self.name, self._ecu, self._at_ns, self._act = ecu.name, ecu, at_ns, act

    def advance(self, t_ns):
        if self._act and t_ns >= self._at_ns:
            self._act()
            self._act = None
        return self._ecu.advance(t_ns)

    def receive(self, frame: Frame, t_ns):
        self._ecu.receive(frame, t_ns)

    def sent(self, handle, t_ns):
        self._ecu.sent(handle, t_ns)

    def where(self):
        return self._ecu.where()


@pytest.fixture
def lap():
    return wavy_lap(3.0)


def predictions(run) -> list[tuple[int, bytes]]:
    return [(d.t_end_ns, d.frame.data[:2]) for d in run.ride.frames if d.frame.id == STATUS]


def test_flipped_byte_of_the_weights_gives_other_predictions(lap, mcu_ecu, image, calibration):
    """One byte of the weights flipped in flash at 1.5 s: the same predictions before, others after."""
    from targets.emulated import EmulatedEcu

    other = EmulatedEcu(image, calibration)
    weights = len(calibration.image()) - 4 * network().neurons

    def flip():
        other.mcu.flash[other.calibration_at + weights + 3] ^= 1

    intact = predictions(run_lap(lap, mcu_ecu))
    tampered = predictions(run_lap(lap, Tampered(other, 1500 * MS, flip)))
    pairs = list(zip(intact, tampered, strict=True))
    assert all(a[1] == b[1] for a, b in pairs if a[0] < 1500 * MS)
    late = [a[1] != b[1] for a, b in pairs if a[0] > 1500 * MS]
    assert np.mean(late) > 0.95


def test_hung_firmware_is_an_overrun_with_the_program_counter(lap, mcu_ecu):
    """A firmware that begins to hang in a loop ends the run as INVALID within two periods, and says where."""
    step = mcu_ecu.mcu.image.symbol("ecu_step")

    def hang():
        mcu_ecu.mcu.patch(step, bytes.fromhex("fee7"))  # b .

    run = run_lap(lap, Tampered(mcu_ecu, 1500 * MS, hang))
    assert run.watch.answered == 150
    assert run.verdict.outcome is Outcome.INVALID
    assert "ECU overrun" in run.verdict.reason
    assert f"pc {step:#010x} in ecu_step" in run.verdict.reason
    assert run.ride.end_ns <= 1520 * MS
