"""Calibration images for the core's tests: built in Python, with words of their heads replaced."""

import re
import struct
import zlib
from functools import cache

from targets.calibration import Calibration
from targets.detector import AnyDetector
from targets.firmware import HERE
from tests.conftest import network

_HEADER = (HERE / "core" / "calibration.h").read_text(encoding="utf-8")
_HEAD = _HEADER[_HEADER.index("    uint32_t magic;") : _HEADER.index("    input_scaling input")]
FIELDS = {name: kind for kind, name in re.findall(r"^    (uint32_t|float) (\w+);", _HEAD, re.MULTILINE)}
"""The 32-bit words of an image's head in order, by name, with their C types."""


def sealed(image: bytes, **words: float) -> bytes:
    """The image with words of its head replaced, an int as uint32_t and a float as float; good checksum."""
    content = bytearray(image)
    for name, value in words.items():
        struct.pack_into(
            "<f" if isinstance(value, float) else "<I", content, 4 * list(FIELDS).index(name), value
        )
    return resealed(bytes(content))


def resealed(image: bytes) -> bytes:
    """The image with its checksum put right."""
    return image[:12] + zlib.crc32(image[16:]).to_bytes(4, "little") + image[16:]


@cache
def image_of(detector: AnyDetector, neurons: int = 1, delays: int = 1, shift: int = 0) -> bytes:
    """The image of a small network with `detector`."""
    return Calibration(network(neurons, delays, shift=shift), detector).image()
