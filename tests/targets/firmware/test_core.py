"""The core's tanh, and what it makes of calibrations, good and bad."""

import ctypes
from dataclasses import fields, replace

import numpy as np
import pytest

from targets.calibration import MAX_WEIGHT, ROOM, Calibration, Detector
from targets.detector import DETECTORS
from tests.conftest import network
from tests.targets.firmware.images import FIELDS, image_of, resealed, sealed

OK, ABSENT, SHAPE, CRC, NUMBER = range(5)

TANSIG = """
#include <stdint.h>
#include "tansig.h"
void many(const float *x, float *y, uint32_t n);
void many(const float *x, float *y, uint32_t n) {
    for (uint32_t i = 0; i < n; i++) y[i] = tansig_of(x[i], tansig_read());
}
"""


@pytest.fixture(scope="module")
def tansig(compiled):
    """tansig of a float32 array."""
    library = ctypes.CDLL(str(compiled("tansig.so", TANSIG, "-O2", "-shared", "-fPIC")))

    def many(x):
        x = np.ascontiguousarray(x, dtype=np.float32)
        y = np.empty_like(x)
        library.many(x.ctypes.data_as(ctypes.c_void_p), y.ctypes.data_as(ctypes.c_void_p), len(x))
        return y

    return many


TANSIG_ERROR = 4e-7
"""Largest relative error, that of single-precision evaluation: the rational function itself is 6e-9 off."""


def test_tansig_is_tanh(tansig):
    """The rational function is tanh to 4e-7 of its value, for tiny and for large arguments alike."""
    x = np.concatenate([np.linspace(-12, 12, 400_001), np.geomspace(1e-30, 12, 100_001)]).astype(np.float32)
    exact = np.tanh(x.astype(np.float64))
    assert np.isfinite(tansig(x)).all()
    assert (np.abs(tansig(x) - exact) <= TANSIG_ERROR * np.abs(exact)).all()


def test_tansig_is_odd_and_bounded(tansig):
    """Its values are exactly odd, within one unit of [-1, 1], and the ends hold for any magnitude."""
    x = np.concatenate([np.linspace(0, 20, 100_001), [1e10, 3e38, np.inf]]).astype(np.float32)
    y = tansig(x)
    np.testing.assert_array_equal(tansig(-x), -y)
    assert y.max() <= np.nextafter(np.float32(1), np.float32(2))
    assert (y[x >= 8] == y[-1]).all()
    assert y[-1] == pytest.approx(1, abs=TANSIG_ERROR)
    assert tansig(np.array([0.0]))[0] == 0


def test_good_calibration(core, calibration):
    """What the Python side writes the C side accepts, from the smallest to the largest."""
    assert core.init(calibration.image(), room=ROOM) == OK
    for shape in ((1, 1), (32, 16), (25, 7)):
        assert core.init(Calibration(network(*shape)).image()) == OK


def test_settings_at_their_ends(core):
    """Every setting of either detector may lie at either end of the bounds that the Python side keeps."""
    for kind in DETECTORS.values():
        for setting in fields(kind):
            for end in setting.metadata.get("bounds", ()):
                assert core.init(image_of(kind(**{setting.name: end}))) == OK, (setting.name, end)


def test_weights_at_their_ends(core):
    """So may every weight."""
    net = network(2, 1)
    for sign in (-1, 1):
        most = replace(net, W1=np.full_like(net.W1, sign * MAX_WEIGHT), w2=np.full(2, -sign * MAX_WEIGHT))
        assert core.init(Calibration(replace(most, b2=sign * MAX_WEIGHT)).image()) == OK


def test_no_calibration(core):
    """Erased flash, and zeros, are no calibration."""
    assert core.init(b"\xff" * ROOM) == ABSENT
    assert core.init(bytes(ROOM)) == ABSENT


HEADS = [
    ({}, OK),
    ({"magic": 1}, ABSENT),
    ({"version": 1}, ABSENT),
    ({"neurons": 0}, SHAPE),
    ({"neurons": 33}, SHAPE),
    ({"neurons": 14}, SHAPE),
    ({"neurons": 2**32 - 1}, SHAPE),
    ({"delays": 0}, SHAPE),
    ({"delays": 17}, SHAPE),
    ({"inputs": 0}, SHAPE),
    ({"inputs": 8}, SHAPE),
    ({"shift": 16}, SHAPE),
    ({"window": 0}, SHAPE),
    ({"window": 129}, SHAPE),
    ({"multiple": 0}, SHAPE),
    ({"multiple": 10_001}, SHAPE),
    ({"multiple": 2**25, "window": 128}, SHAPE),
    ({"detector": 2}, SHAPE),
    ({"hold_window": 1}, SHAPE),
    ({"hold_window": 129}, SHAPE),
    ({"loss_window": 0}, SHAPE),
    ({"loss_window": 513}, SHAPE),
    ({"size": 0}, SHAPE),
    ({"size": 2**32 - 1}, SHAPE),
    ({"floor_mm": 0.0}, NUMBER),
    ({"floor_mm": -1.0}, NUMBER),
    ({"floor_mm": 9.9e-7}, NUMBER),
    ({"loss_floor_mm": 0.0}, NUMBER),
    ({"loss_floor_mm": 9.9e-7}, NUMBER),
]


@pytest.mark.parametrize(("words", "fault"), HEADS)
def test_head_out_of_bounds(core, calibration, words, fault):
    """A head that asks for more than the core has room for is refused, with a good checksum, too."""
    assert core.init(sealed(calibration.image(), **words)) == fault


INPUT_AT, INPUTS, BIAS_AT = len(FIELDS), 3, len(FIELDS) + 3 * 7
"""Where the words of the inputs begin, three for each, and where the output bias and the weights do."""


def test_numbers_out_of_bounds(core):
    """A number that is none, or beyond a thousand million, is refused wherever it stands."""
    image = image_of(Detector())
    floats = [at for at, kind in enumerate(FIELDS.values()) if kind == "float"]
    floats += [INPUT_AT + 3 * k + of for k in range(INPUTS) for of in (1, 2)]
    floats += range(BIAS_AT, len(image) // 4)
    for value in (np.nan, np.inf, -np.inf, 1.001e9, -1.001e9):
        for at in floats:
            content = np.frombuffer(image, "<f4").copy()
            content[at] = value
            assert core.init(resealed(content.tobytes())) == NUMBER, at


def test_channel_out_of_bounds(core):
    """An input from a channel that the core does not read is refused."""
    for k in range(INPUTS):
        content = np.frombuffer(image_of(Detector()), "<u4").copy()
        content[INPUT_AT + 3 * k] = 7
        assert core.init(resealed(content.tobytes())) == SHAPE


def test_size_beyond_the_room(core, calibration):
    """An image that fits its own size word but not the flash section is refused."""
    image = calibration.image()
    assert core.init(image, room=len(image)) == OK
    assert core.init(image, room=len(image) - 4) == SHAPE


def test_damaged_content(core, calibration):
    """Any byte changed behind the head breaks the checksum."""
    image = calibration.image()
    for at in range(4 * BIAS_AT, len(image), 37):
        damaged = bytearray(image)
        damaged[at] ^= 0x10
        assert core.init(bytes(damaged)) == CRC
