"""Where a sensor's random numbers come from: the seed, what it measures, and which imperfection draws.

Belongs here: deriving generators. Never: a distribution.

A stream depends on nothing but seed, sensor, time base, the channel's own values and the imperfection: every
lap has its own noise without anyone handing out seeds, another channel more or less changes nothing, and an
imperfection taken away leaves the others as they were.
"""

from collections.abc import Callable
from hashlib import sha256
from typing import TYPE_CHECKING
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from bench.errors import SensorError

if TYPE_CHECKING:
    from hashlib import _Hash

Draw = Callable[[str], np.random.Generator]
"""Name of an imperfection -> its generator, a new one at the same place at each call."""


def time_base(t_ns: NDArray[np.int64]) -> "_Hash":
    """The digest so far of a time base int64 (samples,), from 0 at the lap's start."""
    return sha256(t_ns.data)


def streams(seed: int, base: "_Hash", sensor: str, values: NDArray[np.float64]) -> Draw:
    """The generators of `sensor`, which measures `values` float64 (samples,) on the time base `base`.

    Raises SensorError for a negative seed.
    """
    if seed < 0:
        raise SensorError(f"seed {seed} is below zero")
    digest = base.copy()
    digest.update(sensor.encode() + b"\0")
    digest.update(values.data)
    key = int.from_bytes(digest.digest()[:16], "big")

    def draw(imperfection: str) -> np.random.Generator:
        entropy = np.random.SeedSequence([seed, key, crc32(imperfection.encode())])
        return np.random.Generator(np.random.SFC64(entropy))

    return draw
