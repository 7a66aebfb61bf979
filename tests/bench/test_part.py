"""A part of a lap: cut, and ridden more than once."""

import numpy as np
import pytest

from bench.errors import LapError
from bench.part import Part
from bench.sensors.codes import acquire
from tests.conftest import wavy_lap

MS = 1_000_000
CODES = acquire(wavy_lap(0.5))


def test_whole_lap_is_untouched():
    """The default part is the lap itself."""
    assert Part().of(CODES) is CODES


def test_cut():
    """From 0.1 to 0.2 s both ends are in, and time begins at 0."""
    part = Part(100 * MS, 200 * MS).of(CODES)
    assert part.t_ns.tolist() == [k * MS for k in range(101)]
    for sensor, codes in CODES.codes.items():
        assert np.array_equal(part.codes[sensor], codes[100:201])


def test_loops():
    """Three loops follow each other in the lap's own step."""
    part = Part(0, 9 * MS, 3).of(CODES)
    assert part.t_ns.tolist() == [k * MS for k in range(30)]
    assert np.array_equal(part.codes["speed"], np.tile(CODES.codes["speed"][:10], 3))


@pytest.mark.parametrize(
    ("part", "says"),
    [
        (Part(600 * MS), "nothing to ride from 0.6 to 0.499 s: the lap lasts 0.499 s"),
        (Part(200 * MS, 100 * MS), "nothing to ride from 0.2 to 0.1 s"),
        (Part(loops=10**7), "10000000 loops of 500 samples"),
    ],
)
def test_refused(part, says):
    """A part without samples, and one that nobody can hold, are refused by their values."""
    with pytest.raises(LapError, match=says):
        part.of(CODES)
