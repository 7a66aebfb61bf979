"""Measured profiles as roads: read from a file, put on the road's grid, freed of hills.

Belongs here: which file holds a profile, the text formats, and what is done to every profile. Never: the
OpenCRG format.

FIDELITY: one line of heights; of waves shorter than twice the file's spacing there are none.
"""

import io
import re
from array import array
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.errors import RouteError
from bench.plant.road import opencrg
from bench.plant.road.grid import LONGEST_WAVE_M, STEP_M
from bench.plant.road.limits import HIGHEST_M, check_number

LARGEST_BYTES = {".crg": 64 << 20, ".csv": 16 << 20, ".txt": 16 << 20, ".dat": 16 << 20}
LONGEST_M = 20_000.0
SHORTEST_M = 1.0
_OVERSAMPLING = 8

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Profile:
    """A measured road: heights in metres every STEP_M, the first at zero, without its hills."""

    name: str
    height_m: Array

    def filled(self, count: int) -> Array:
        """`count` heights, the profile there and back again as often as it takes."""
        last = len(self.height_m) - 1
        place = np.arange(count) % (2 * last)
        return self.height_m[np.minimum(place, 2 * last - place)]


def load_profile(path: Path, v_m: float = 0.0) -> Profile:
    """Read a profile from .crg (the line `v_m` metres to the left of the reference line), .csv, .txt or .dat.

    Raises RouteError naming the file, the place in it and what is wrong there.
    """
    suffix = path.suffix.lower()
    if suffix not in _READERS:
        raise RouteError(f"{path}: unknown kind of profile; the known ones are {', '.join(_READERS)}")
    check_number("profile_v_m", v_m, -100.0, 100.0)
    try:
        x, z = _READERS[suffix](_content(path, LARGEST_BYTES[suffix]), v_m)
        return Profile(path.name, on_grid(x, z))
    except RouteError as error:
        raise RouteError(f"{path}: {error}") from None


def on_grid(x_m: Array, z_m: Array) -> Array:
    """Heights (samples,) every STEP_M from heights at rising places (points,): each the mean over its step.

    The straight line through them and every wave longer than LONGEST_WAVE_M are taken out: the grade's part.
    Raises RouteError for a profile shorter than a metre or longer than 20 km.
    """
    length = float(x_m[-1] - x_m[0])
    check_number("the profile's length in metres", length, SHORTEST_M, LONGEST_M)
    count = int(length / STEP_M + 1e-6) + 1
    fine = np.arange(count * _OVERSAMPLING) - 0.5 * (_OVERSAMPLING - 1)
    heights = np.interp(fine * (STEP_M / _OVERSAMPLING), x_m - x_m[0], z_m - z_m[0])
    return _without_hills(heights.reshape(count, _OVERSAMPLING).mean(axis=1))


def _without_hills(height: Array) -> Array:
    count = len(height)
    place = np.arange(count) - 0.5 * (count - 1)
    level = height - np.mean(height)
    level = level - place * (np.sum(place * level) / np.sum(place * place))
    # there and back again, as the profile is ridden: no jump for the filter to ring on
    spectrum = np.fft.rfft(np.concatenate([level, level[::-1]]))
    spectrum[np.fft.rfftfreq(2 * count, STEP_M) < 1.0 / LONGEST_WAVE_M] = 0.0
    level = np.fft.irfft(spectrum, 2 * count)[:count]
    return level - level[0]


def _content(path: Path, largest: int) -> bytes:
    if not path.is_file():
        raise RouteError("no such file")
    try:
        with path.open("rb") as file:
            content = file.read(largest + 1)
    except OSError as problem:
        raise RouteError(f"cannot be read: {problem.strerror}") from None
    if len(content) > largest:
        raise RouteError(f"is larger than {largest >> 20} MiB")
    return content


_NUMBER = re.compile(r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?", re.ASCII)
_WIDEST = 200  # characters of a line; two numbers in full take 50
_COMMENT = ("#", "%", "//", ";", "*")


def read_columns(content: bytes, v_m: float = 0.0) -> tuple[Array, Array]:
    """Places and heights in metres from text of two columns, comma, semicolon or blanks between them.

    Blank lines, lines that begin like a comment and one line of headings are passed over. `v_m` is not used.
    Raises RouteError naming the line.
    """
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as problem:
        raise RouteError(f"byte {problem.start}: not text") from None
    x, z = array("d"), array("d")
    heading = False
    for number, line in enumerate(io.StringIO(text), 1):
        if not line.strip() or line.lstrip().startswith(_COMMENT):
            continue
        if len(line) > _WIDEST:
            raise RouteError(f"line {number}: {_short(line)} is not two numbers")
        words = re.split(r"\s*[,;]\s*|\s+", line.strip())
        if not x and not heading and not any(_NUMBER.fullmatch(word) for word in words):
            heading = True
            continue
        if len(words) != 2 or not all(_NUMBER.fullmatch(word) for word in words):
            raise RouteError(f"line {number}: {_short(line)} is not two numbers")
        place, height = float(words[0]), float(words[1])
        if x and not place > x[-1]:
            raise RouteError(f"line {number}: place {place:g} m is not beyond {x[-1]:g} m")
        if not (abs(place) < 1e9 and abs(height) <= HIGHEST_M):
            raise RouteError(f"line {number}: {_short(line)} is no place and height on earth, in metres")
        x.append(place)
        z.append(height)
    if len(x) < 2:
        raise RouteError(f"holds {len(x)} points; a profile takes two")
    return np.array(x), np.array(z)


def _short(line: str) -> str:
    line = line.strip()
    return repr(line if len(line) <= 40 else line[:40] + "...")


def _read_crg(content: bytes, v_m: float) -> tuple[Array, Array]:
    grid = opencrg.parse(content)
    z = opencrg.line(grid, v_m)
    return np.arange(len(z), dtype=np.float64) * grid.step_m, z


_READERS: dict[str, Callable[[bytes, float], tuple[Array, Array]]] = {
    ".crg": _read_crg,
    ".csv": read_columns,
    ".txt": read_columns,
    ".dat": read_columns,
}
