"""Sufni suspension telemetry (.SST, version 3): fork and shock of a bicycle, read through a channel map.

A header of 16 bytes, little-endian: "SST", version, samples a second (u16), 2 bytes of no use, time (i64).
Then pairs of u16, front and rear: counts of an AS5600 magnetic angle sensor, 4096 a turn, 0 fully extended.
The map gives the triangles they sit in, in millimetres (the project's calibration methods of these names):

    [channels.fork_stroke_mm]
    signal = "front"
    [channels.rear_stroke_mm]
    signal = "rear"

    [sst]
    front = { arm = 134.9375, max = 234.15625 }        # as5600-isosceles-triangle
    rear = { arm1 = 98.9, arm2 = 202.8, max = 230.0 }  # as5600-triangle

max: the side that shortens, at full extension; the stroke is what it has lost. `maps/clash2022.toml`, beside
this file, is the map of the recordings that the project publishes. Not written: a lap knows no geometry.

Belongs here: this format and its two triangles. Never: formulas read from a file.
"""

import math
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.errors import LapError
from bench.laps.channel_map import ChannelMap
from bench.laps.mavlink.messages import content
from bench.laps.recording import Recording, Track

MAPS = Path(__file__).with_name("maps")
_HEAD = struct.Struct("<3sBHHq")
_TURN = 4096
_BELOW = 64
"""A sensor up to so many counts below 0 is at rest. FIDELITY: its stroke is 0, the project's own rule."""
_SIDES = {"front": ("arm", "max"), "rear": ("arm1", "arm2", "max")}


def read(path: Path, channel_map: ChannelMap | None = None) -> Recording:
    """Read a recording; samples whose counts no triangle of the map makes are dropped and are damage.

    A file cut after a whole sample cannot be told from a shorter one, nor a damaged count within range from
    a right one: the format has neither length nor checksum.
    Raises LapError for another header or version, for a map without the geometry, for an odd end with no
    sample before it, and if more than one sample in a hundred, and more than one, is impossible.
    """
    data = content(path)
    rate_hz = _rate_hz(data[: _HEAD.size].tobytes(), path)
    if channel_map is None:
        raise LapError(
            f"{path}: holds angles, not strokes; needed is a channel map with [sst], such as "
            f"{MAPS / 'clash2022.toml'}"
        )
    whole = (len(data) - _HEAD.size) // 4
    counts = data[_HEAD.size : _HEAD.size + 4 * whole].view("<u2").reshape(-1, 2).astype(np.int64)
    damage = []
    if len(data) != _HEAD.size + 4 * whole:
        at = _HEAD.size + 4 * whole
        damage.append(f"bytes {at} to {len(data) - 1}: cut within a sample")
    good = np.ones(whole, dtype=bool)
    strokes = {}
    for row in channel_map.rows.values():
        if row.signal not in _SIDES:
            raise LapError(f"{channel_map.where}: signal {row.signal!r}; a .sst file has {', '.join(_SIDES)}")
        sides = _sides(channel_map, row.signal)
        column = list(_SIDES).index(row.signal)
        raw = counts[:, column]
        stroke_mm, possible = (_front if row.signal == "front" else _rear)(
            np.where(raw < _TURN, raw, 0), sides
        )
        wild = np.flatnonzero(~possible | (raw >= _TURN))
        if wild.size:
            first = wild[0]
            line = (
                f"{row.signal}: {wild.size} of {whole} samples are no angle of its triangle, the first "
                f"{raw[first]} at byte {_HEAD.size + 4 * first + 2 * column}"
            )
            if wild.size > max(1, whole // 100):
                raise LapError(f"{path}: {line}; is it the geometry of {channel_map.where}?")
            damage.append(f"{line}; dropped")
            good[wild] = False
        strokes[row.channel] = row.convert(stroke_mm, "mm", str(path))
    t_ns = np.rint(np.arange(whole) * (1e9 / rate_hz)).astype(np.int64)[good]
    tracks = {name: Track(t_ns, values[good]) for name, values in strokes.items()}
    return Recording(
        str(path), path.name, tracks, channel_map.rate_hz is None, channel_map.rate_hz, tuple(damage)
    )


def _rate_hz(head: bytes, path: Path) -> int:
    if len(head) < _HEAD.size:
        raise LapError(f"{path}: {len(head)} bytes, less than the header's {_HEAD.size}")
    magic, version, rate_hz, _, _ = _HEAD.unpack(head)
    if magic != b"SST":
        raise LapError(f"{path}: byte 0: begins with {magic!r}, not with b'SST'")
    if version != 3:
        raise LapError(f"{path}: byte 3: version {version}; version 3 is known")
    if rate_hz == 0:
        raise LapError(f"{path}: byte 4: 0 samples a second")
    return rate_hz


def _sides(channel_map: ChannelMap, signal: str) -> Mapping[str, float]:
    """The sides of one triangle, checked, mm."""
    for key in channel_map.sst or {}:
        if key not in _SIDES:
            raise LapError(
                f"{channel_map.where}: unknown key sst.{key}; the known ones are {', '.join(_SIDES)}"
            )
    known = _SIDES[signal]
    where = f"{channel_map.where}: sst.{signal}"
    table: Any = (channel_map.sst or {}).get(signal)
    if not isinstance(table, dict) or set(table) != set(known):
        raise LapError(f"{where} is {table!r}; it needs {', '.join(known)} in millimetres")
    for name, side in table.items():
        if isinstance(side, bool) or not isinstance(side, int | float) or not 0 < side < 1e4:
            raise LapError(f"{where}: {name} is {side!r}, not a length in millimetres")
    arms = [float(table[name]) for name in known[:-1]]
    if not abs(arms[0] - arms[-1]) < table["max"] < arms[0] + arms[-1]:
        raise LapError(f"{where}: no triangle has the sides {', '.join(f'{n} {table[n]:g}' for n in known)}")
    return table


def _front(
    counts: NDArray[np.int64], sides: Mapping[str, float]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Strokes in mm, and which counts a triangle can have: two equal arms, the sensor at a foot of them."""
    arm, longest = sides["arm"], sides["max"]
    turned, near = _turned(counts)
    # start = acos(max / 2 / arm); stroke = max - 2 arm cos(angle + start)
    angle = turned + math.acos(longest / 2 / arm)
    return longest - 2 * arm * np.cos(angle), near & (angle <= math.pi / 2)


def _rear(
    counts: NDArray[np.int64], sides: Mapping[str, float]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Strokes in mm, and which counts a triangle can have: the sensor between two arms."""
    one, other, longest = sides["arm1"], sides["arm2"], sides["max"]
    turned, near = _turned(counts)
    # start = acos((arm1^2 + arm2^2 - max^2) / (2 arm1 arm2));
    # stroke = max - sqrt(arm1^2 + arm2^2 - 2 arm1 arm2 cos(start - angle))
    angle = math.acos((one**2 + other**2 - longest**2) / (2 * one * other)) - turned
    side = np.sqrt(one**2 + other**2 - 2 * one * other * np.cos(angle))
    return longest - side, near & (angle >= 0)


def _turned(counts: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Radians from full extension, and whether that is within a quarter turn."""
    at_rest = counts >= _TURN - _BELOW
    turned = np.where(at_rest, 0, counts)
    return turned * (2 * math.pi / _TURN), turned <= _TURN // 4
