"""Initial and compiler-optimised code: the same scheme as the shipped one, to single precision."""

import ctypes
import math

import numpy as np
import pytest

from bench.codec import Codec
from bench.mdlog.logger import sampled, schedule
from bench.rig import ride
from bench.sensors.codes import acquire
from bench.watch import Watch
from targets.calibration import Calibration, Detector
from targets.detector import Checks
from targets.emulated import EmulatedEcu
from targets.firmware import HERE, STEP_ELF
from targets.mcu.image import load
from tests.conftest import network, wavy_lap

CODEC = Codec()

EXPONENTIAL = """
#include "../steps/exponential.h"
double one(double x);
double one(double x) { return exponential(x); }
"""


def answers(code, calibration, lap):
    """Predictions and residuals, (cycles, 2), of a step's code over a lap."""
    codes = acquire(lap)
    watch = Watch(CODEC)
    ecu = EmulatedEcu(load(STEP_ELF[code]), calibration)
    assert ride(schedule(codes, CODEC), ecu, watch).failure is None
    return np.array([answer[1:] for answer in watch.answers])


@pytest.mark.parametrize("code", ["initial", "compiler"])
@pytest.mark.parametrize(
    "calibration",
    [
        Calibration(network()),
        Calibration(network(4, 3, shift=2), Detector(window=7)),
        Calibration(network(2, 2), Detector(feedback="measured")),
        Calibration(network(2, 2), Checks()),
    ],
    ids=["usual", "shifted", "measured", "checks"],
)
def test_step_answers_as_the_final_code(code, calibration):
    """Every code predicts the same stroke and the same residual, to a unit of the status frame."""
    lap = wavy_lap(0.6)
    ours, final = answers(code, calibration, lap), answers("final", calibration, lap)
    assert len(ours) == 60
    np.testing.assert_allclose(ours[:, 0], final[:, 0], rtol=0, atol=0.0021)
    np.testing.assert_allclose(ours[:, 1], final[:, 1], rtol=0, atol=0.011)


@pytest.mark.parametrize("code", ["initial", "compiler"])
def test_step_predicts_what_the_network_does(code):
    """The code's free run is the network's in double precision."""
    lap, net = wavy_lap(0.6), network()
    seen = sampled(acquire(lap))
    u = np.stack([seen[name] for name in net.inputs], axis=1)
    np.testing.assert_allclose(
        answers(code, Calibration(net), lap)[:, 0], net.free_run(u), rtol=0, atol=0.002
    )


def test_exponential_is_that_of_a_library(compiled):
    """The library's exponential is right to two units in the last place, and saturates at its ends."""
    path = compiled(
        "exponential.so", EXPONENTIAL, HERE / "steps" / "exponential.c", "-O2", "-shared", "-fPIC"
    )
    one = ctypes.CDLL(str(path)).one
    one.restype, one.argtypes = ctypes.c_double, [ctypes.c_double]
    for x in [*np.linspace(-700, 700, 4001), *np.linspace(-3, 3, 4001), 0.0]:
        assert one(x) == pytest.approx(math.exp(x), rel=2.5 * 2**-52)
    assert one(1e300) == one(708.0)
    assert one(-1e300) == one(-708.0) > 0
