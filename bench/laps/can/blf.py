"""CAN logs of Vector's binary format, .blf: unpacked and checked here, its frames read by python-can.

Belongs here: the file's containers and how its objects follow each other, as far as a damaged file could make
python-can hang, swallow memory or stop in silence. Never: the inside of a CAN object, a signal.
A bus is the channel number as the file shows it. Times count from the start of the measurement.

The format has no public description; this follows python-can, which follows Toby Lorenz's Vector BLF.
"""

import io
import struct
import zlib
from pathlib import Path
from typing import TYPE_CHECKING

from bench.errors import LapError
from bench.laps.can import log as can_log
from bench.laps.can.frames import MOST_BYTES, Damage, Frames, gather
from bench.laps.channel_map import ChannelMap
from bench.laps.lap import Lap
from bench.laps.recording import Recording
from bench.quiet import quiet

if TYPE_CHECKING:
    from collections.abc import Iterator

    import can

_HEAD = struct.Struct(
    "<4sL8BQQLL"
)  # signature, size, versions; file size, unpacked size, objects, objects read
_OBJECT = struct.Struct("<4sHHLL")  # signature, header size, header version, object size, type
_CONTAINER = struct.Struct("<H6xL4x")  # compression, unpacked size
_SHORTEST_HEAD, _STORED, _DEFLATED, _LOG_CONTAINER, _UNCOUNTED = 72, 0, 2, 10, 115
_VERSIONS = {1: 32, 2: 40}
"""Version of an object's header -> its bytes."""
_FRAMES = {1: 16, 86: 16, 73: 32, 100: 84, 101: 40}
"""Types that python-can reads (message, again, error, two of CAN FD) -> least bytes after the header."""


def read(path: Path, channel_map: ChannelMap | None = None) -> Recording:
    """Read a log through the map's DBC; to the nanosecond. A log cut short is read as far as it goes.

    Raises LapError naming the byte of the file or the number of the object where it is damaged.
    """
    return can_log.recording(path, parse(can_log.content(path), str(path)), channel_map)


def write(lap: Lap, path: Path) -> None:
    """Write what the logger would send during `lap`; nanoseconds, channel 1."""
    can_log.write(lap, path, ".blf")


def parse(data: bytes, where: str) -> Frames:
    """The frames of a log's bytes."""
    if len(data) < _SHORTEST_HEAD or data[:4] != b"LOGG":
        raise LapError(f"{where}: not a BLF file")
    _, head, *_, size, _, promised, _ = _HEAD.unpack_from(data)
    if not _SHORTEST_HEAD <= head <= len(data):
        raise LapError(f"{where}: header of {head} bytes")
    damage = []
    if len(data) < size:
        damage.append(f"cut short: {len(data)} of {size} bytes")
    objects = _unpacked(data, head, where, damage)
    found, numbers, body = _objects(objects, where, damage)
    if found < promised:
        damage.append(f"{found} of the {promised} objects that its header counts")
    elif found > promised:
        damage.append(f"not closed: its header counts {promised} objects, {found} are there")
    wrong = Damage(where, "object")
    with quiet("can"):
        frames = gather(_messages(_reader(body), numbers, where), wrong, 1, lambda: tuple(damage))
    if len(frames) + wrong.count < len(numbers):
        raise LapError(f"{where}: {len(frames)} of its {len(numbers)} frames could be read")
    return frames


def _unpacked(data: bytes, pos: int, where: str, damage: list[str]) -> bytes:
    """What the containers hold, end to end, for an object may lie across two of them."""
    parts, room = [], MOST_BYTES
    while pos < len(data):
        if len(data) - pos < _OBJECT.size:
            damage.append(f"byte {pos}: cut short")
            break
        signature, _, _, size, kind = _OBJECT.unpack_from(data, pos)
        if signature != b"LOBJ" or size < _OBJECT.size:
            raise LapError(f"{where}: byte {pos}: no object")
        end = pos + size
        if end > len(data):
            damage.append(f"byte {pos}: cut short, {len(data) - pos} bytes of an object of {size}")
        if kind == _LOG_CONTAINER:
            part = _container(data[pos + _OBJECT.size : end], room, f"{where}: byte {pos}", end > len(data))
        else:
            part = data[pos:end]
        room -= len(part)
        parts.append(part)
        pos = end + size % 4
    return b"".join(parts)


def _container(body: bytes, room: int, where: str, cut: bool) -> bytes:
    if len(body) < _CONTAINER.size:
        if cut:
            return b""
        raise LapError(f"{where}: a container of {len(body)} bytes")
    method, size = _CONTAINER.unpack_from(body)
    body = body[_CONTAINER.size :]
    if size > room:
        raise LapError(f"{where}: unpacks to more than {MOST_BYTES} bytes: cut the log to the lap")
    if method == _DEFLATED:
        inflater = zlib.decompressobj()
        try:
            body = inflater.decompress(body, size + 1)
        except zlib.error as error:
            raise LapError(f"{where}: a container does not unpack: {error}") from None
    elif method != _STORED:
        raise LapError(f"{where}: a container packed by method {method}")
    if len(body) != size and not (cut and len(body) < size):
        raise LapError(f"{where}: a container of {len(body)} bytes, not {size}")
    return body


def _objects(data: bytes, where: str, damage: list[str]) -> tuple[int, list[int], bytes]:
    """How many objects there are, the numbers from 1 of those that are frames, and these end to end."""
    count, numbers, parts, pos = 0, [], [], 0
    while True:
        # padding depends on the type and the writer: less than a word of two
        start = data.find(b"LOBJ", pos, pos + 8)
        if start < 0 or start + _OBJECT.size > len(data):
            break
        _, _, version, size, kind = _OBJECT.unpack_from(data, start)
        if start + size > len(data):
            break
        head = _VERSIONS.get(version, 0)
        if size < _OBJECT.size or (kind in _FRAMES and (head == 0 or size < head + _FRAMES[kind])):
            raise LapError(f"{where}: object {count + 1}: type {kind}, header {version}, {size} bytes")
        count += kind != _UNCOUNTED
        if kind in _FRAMES:
            numbers.append(count)
            parts.append(data[start : start + size + -size % 4].ljust(size + -size % 4, b"\0"))
        pos = start + size
    if data[pos:].strip(b"\0"):
        if start < 0 and len(data) - pos >= 8:
            raise LapError(f"{where}: object {count + 1}: no object after {pos} unpacked bytes")
        damage.append(f"object {count + 1}: cut short")
    return count, numbers, b"".join(parts)


def _reader(body: bytes) -> "can.BLFReader":
    """python-can's reader over one stored container, in a file that starts at time 0."""
    import can

    head = b"LOGG" + struct.pack("<L", _SHORTEST_HEAD) + bytes(_SHORTEST_HEAD - 8)
    container = _CONTAINER.pack(_STORED, len(body))
    size = _OBJECT.size + len(container) + len(body)
    outer = _OBJECT.pack(b"LOBJ", _OBJECT.size, 1, size, _LOG_CONTAINER)
    return can.BLFReader(io.BytesIO(head + outer + container + body))


def _messages(reader: "can.BLFReader", numbers: list[int], where: str) -> "Iterator[tuple[int, can.Message]]":
    at = 0
    try:
        for at, message in zip(numbers, reader, strict=False):
            yield at, message
    except Exception as error:  # whatever python-can's parsing stumbled over
        raise LapError(f"{where}: after object {at}: {' '.join(str(error).split())}") from None
