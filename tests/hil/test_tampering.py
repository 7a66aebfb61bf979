"""The firmware under the rig is executed: tampering with its flash while it rides shows on the bus."""

import numpy as np
import pytest

from bench.run import run_lap
from bench.sensors.datasheets import load_sensors
from bench.verdict import Outcome
from tests.conftest import wavy_lap

STATUS = 0x200
MS = 1_000_000


@pytest.fixture
def lap():
    return wavy_lap(3.0)


def predictions(rows) -> list[tuple[int, bytes]]:
    return [(t_ns, frame.data[:2]) for t_ns, frame, _ in rows if frame.id == STATUS]


def test_flipped_byte_of_the_weights_gives_other_predictions(bench, ecu, bus, lap):
    """One byte of the weights flipped in flash at 1.5 s: the same predictions before, others after."""
    calibration = ecu.build.calibration
    weights = len(calibration.image()) - 4 * calibration.network.neurons
    bench.ride_to(1.5)
    ecu.device.mcu.flash[ecu.device.calibration_at + weights + 3] ^= 1
    bench.finish()
    intact = run_lap(lap, ecu.build.power_on(), sensors=load_sensors("datasheet")).ride.frames
    pairs = list(
        zip(predictions((d.t_end_ns, d.frame, d.node) for d in intact), predictions(bus.frames), strict=True)
    )
    assert all(a[1] == b[1] for a, b in pairs if a[0] < 1500 * MS)
    late = [a[1] != b[1] for a, b in pairs if a[0] > 1500 * MS]
    assert np.mean(late) > 0.95


@pytest.mark.unhealthy_bus_ok
def test_hung_firmware_is_an_overrun_with_the_program_counter(bench, ecu):
    """A firmware that begins to hang in a loop ends the run as INVALID within two periods, and says where."""
    step = ecu.device.mcu.image.symbol("ecu_step")
    bench.ride_to(1.5)
    ecu.device.mcu.patch(step, bytes.fromhex("fee7"))  # b .
    verdict = bench.finish()
    assert bench.watch.answered in (150, 151)
    assert verdict.outcome is Outcome.INVALID
    assert "ECU overrun" in verdict.reason
    assert f"pc {step:#010x} in ecu_step" in verdict.reason
    assert bench.now_ns <= 1520 * MS
