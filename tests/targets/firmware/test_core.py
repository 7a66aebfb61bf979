"""The core on this machine: its tanh, its checks of the calibration, and its conduct under the sanitizers."""

import ctypes
import subprocess
import zlib

import numpy as np
import pytest

from targets.calibration import ROOM, Calibration, Detector
from targets.detector import Checks
from targets.firmware import HERE
from tests.conftest import network

CORE = [HERE / "core" / f"{name}.c" for name in ("calibration", "narx", "residual", "checks", "ifd", "ecu")]

TANSIG = """
#include <stdint.h>
#include "tansig.h"
void many(const float *x, float *y, uint32_t n);
void many(const float *x, float *y, uint32_t n) { for (uint32_t i = 0; i < n; i++) y[i] = tansig(x[i]); }
"""

CHECK = """
#include "calibration.h"
int check(const void *image, uint32_t room);
int check(const void *image, uint32_t room) { return calibration_check(image, room); }
"""

RIDE = r"""
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "ecu.h"

static uint32_t seed = 1u;
static uint32_t draw(void) { return seed = seed * 1664525u + 1013904223u; }

/* The image lies in a block of exactly its own size, so that reading past it is found. */
static void ride(const uint8_t *content, uint32_t size, enum role role, int damaged) {
    uint8_t *image = malloc(size);
    ecu *e = malloc(sizeof *e);
    if (!image || !e) exit(3);
    memcpy(image, content, size);
    if (damaged) {
        image[draw() % (damaged == 1 ? 156u : size)] ^= (uint8_t)(1u << draw() % 8u);
        if (ecu_init(e, (const calibration *)(const void *)image, size, role) == CALIBRATION_OK) exit(4);
    } else {
        if (ecu_init(e, (const calibration *)(const void *)image, size, role) != CALIBRATION_OK) exit(5);
        static const uint32_t ids[] = {0x100u, 0x101u, 0x102u, 0x200u, 0u};
        static const uint32_t lengths[] = {4u, 5u, 5u, 7u, 0u};
        uint32_t answers = 0;
        for (uint32_t k = 0; k < 2400u; k++) {
            uint32_t which = draw() >> 8 & 15u;
            uint32_t kind = which < 10u ? k % 2u : which % 5u;
            can_frame f = {.id = ids[kind], .length = which == 15u ? draw() % 9u : lengths[kind]};
            for (uint32_t i = 0; i < 8u; i++) f.data[i] = (uint8_t)(draw() >> 16);
            if (which < 14u) f.data[kind == 0 ? 3 : 4] = (uint8_t)(k / 2u & 15u);
            if (!ecu_receive(e, &f)) continue;
            ecu_step(e);
            ecu_status(e, &f);
            ecu_timing(e, draw(), &f);
            if (k % 7u == 0u) ecu_overrun(e);
            answers++;
        }
        if (answers < 500u) exit(6);
    }
    free(e);
    free(image);
}

int main(int count, char **paths) {
    static uint8_t content[16384];
    for (int i = 1; i < count; i++) {
        FILE *file = fopen(paths[i], "rb");
        if (!file) return 2;
        uint32_t size = (uint32_t)fread(content, 1, sizeof content, file);
        fclose(file);
        for (int role = 0; role < 2; role++) {
            ride(content, size, role == 0 ? ROLE_IFD : ROLE_SOFT_SENSOR, 0);
            for (int k = 0; k < 400; k++) ride(content, size, ROLE_IFD, 1 + k % 2);
        }
    }
    return 0;
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


@pytest.fixture(scope="module")
def check(compiled):
    """calibration_check of an image's bytes: 0 OK, 1 absent, 2 shape, 3 checksum."""
    library = ctypes.CDLL(str(compiled("check.so", CHECK, CORE[0], "-O2", "-shared", "-fPIC")))
    return lambda image, room=ROOM: library.check(ctypes.create_string_buffer(image, ROOM), room)


def sealed(image, **words):
    """The image with 32-bit words of its head replaced and the checksum put right again."""
    names = (
        "magic",
        "version",
        "size",
        "crc32",
        "neurons",
        "delays",
        "inputs",
        "feedback",
        "shift",
        "window",
    )
    names += (
        "multiple",
        "warmup",
        "threshold",
        "floor_mm",
        "initial_mm",
        "out_gain",
        "out_offset",
        "out_scale",
    )
    names += ("detector", "rail_steps", "repeat_steps", "hold_window", "loss_window", "heal_steps")
    content = bytearray(image)
    for name, value in words.items():
        at = 4 * names.index(name)
        content[at : at + 4] = value.to_bytes(4, "little")
    content[12:16] = zlib.crc32(content[16 : len(image)]).to_bytes(4, "little")
    return bytes(content)


def test_good_calibration(check, calibration):
    """What the Python side writes the C side accepts, from the smallest to the largest."""
    assert check(calibration.image()) == 0
    for shape in ((1, 1), (32, 16), (25, 7)):
        assert check(Calibration(network(*shape)).image()) == 0


def test_no_calibration(check):
    """Erased flash, and zeros, are no calibration."""
    assert check(b"\xff" * ROOM) == 1
    assert check(bytes(ROOM)) == 1


@pytest.mark.parametrize(
    ("words", "fault"),
    [
        ({}, 0),
        ({"magic": 1}, 1),
        ({"version": 1}, 1),
        ({"neurons": 0}, 2),
        ({"neurons": 33}, 2),
        ({"neurons": 14}, 2),
        ({"neurons": 2**32 - 1}, 2),
        ({"delays": 0}, 2),
        ({"delays": 17}, 2),
        ({"inputs": 0}, 2),
        ({"inputs": 8}, 2),
        ({"shift": 16}, 2),
        ({"window": 0}, 2),
        ({"window": 129}, 2),
        ({"multiple": 0}, 2),
        ({"detector": 2}, 2),
        ({"hold_window": 1}, 2),
        ({"hold_window": 129}, 2),
        ({"loss_window": 0}, 2),
        ({"loss_window": 513}, 2),
        ({"size": 0}, 2),
        ({"size": 2**32 - 1}, 2),
    ],
)
def test_head_out_of_bounds(check, calibration, words, fault):
    """A head that asks for more than the core has room for is refused, with a good checksum, too."""
    assert check(sealed(calibration.image(), **words)) == fault


def test_size_beyond_the_room(check, calibration):
    """An image that fits its own size word but not the flash section is refused."""
    image = calibration.image()
    assert check(image, len(image)) == 0
    assert check(image, len(image) - 4) == 2


def test_damaged_content(check, calibration):
    """Any byte changed behind the head breaks the checksum."""
    image = calibration.image()
    for at in range(64, len(image), 37):
        damaged = bytearray(image)
        damaged[at] ^= 0x10
        assert check(bytes(damaged)) in (2, 3)


def test_clean_under_the_sanitizers(compiled, tmp_path):
    """Hundreds of steps of garbled frames, and damaged calibrations, with every access watched."""
    shapes = {
        "usual": Calibration(network()),
        "least": Calibration(network(1, 1), Detector(window=1, multiple=1, warmup=0)),
        "most": Calibration(network(32, 16, shift=15), Detector(window=128)),
        "measured": Calibration(network(3, 2), Detector(feedback="measured")),
        "checks": Calibration(network(3, 2), Checks(warmup=0, hold_window=128, loss_window=512)),
        "least checks": Calibration(
            network(3, 2), Checks(warmup=0, hold_window=2, loss_window=1, still_mm=0)
        ),
    }
    for name, calibration in shapes.items():
        (tmp_path / name).write_bytes(calibration.image())
    flags = ("-O1", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    try:
        compiled("probe", "int main(void) { return 0; }\n", *flags)
    except AssertionError:
        pytest.skip("this C compiler has no sanitizers")
    ride = compiled("ride", RIDE, *CORE, *flags)
    done = subprocess.run(
        [ride, *(tmp_path / name for name in shapes)], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
