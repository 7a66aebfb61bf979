"""Lap files and CAN logs with .gz on top: unpacked into a folder of their own, read by the format below.

Belongs here: unpacking under a bound. Never: a format.
"""

import tempfile
import zlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import BinaryIO

from bench.errors import BenchError, LapError
from bench.laps.can.frames import MOST_BYTES
from bench.laps.channel_map import ChannelMap
from bench.laps.recording import Recording

PIECE = 1 << 20


def read(path: Path, channel_map: ChannelMap | None = None) -> Recording:
    """Read `NAME.SUFFIX.gz` as `NAME.SUFFIX`; a file cut short is read as far as it goes.

    Raises LapError if it is no gzip file, is damaged, or unpacks to more than MOST_BYTES.
    """
    from bench.laps.files import format_of

    inner = path.with_suffix("")
    if inner.suffix.lower() == path.suffix.lower():
        raise LapError(f"{path}: packed twice")
    module = format_of(inner)
    damage: list[str] = []
    with tempfile.TemporaryDirectory(prefix="strokebench-") as folder:
        unpacked = Path(folder) / inner.name
        with path.open("rb") as packed, unpacked.open("wb") as file:
            for piece in _unpacked(packed, path, damage):
                file.write(piece)
        if unpacked.stat().st_size == 0:
            raise LapError(f"{path}: {damage[0] if damage else 'empty file'}")
        try:
            recording: Recording = module.read(unpacked, channel_map)
        except BenchError as error:
            raise type(error)(str(error).replace(str(unpacked), str(path))) from None
    return replace(recording, where=str(path), source=path.name, damage=(*damage, *recording.damage))


def _unpacked(packed: BinaryIO, path: Path, damage: list[str]) -> Iterator[bytes]:
    """The contents, piece by piece; `damage` gets a line if the file ends inside them."""
    total, inflater = 0, None
    data = packed.read(PIECE)
    while data:
        inflater = inflater or zlib.decompressobj(wbits=31)
        try:
            piece = inflater.decompress(data, PIECE)
        except zlib.error as error:
            reason = str(error).rpartition(": ")[2]
            raise LapError(f"{path}: damaged after {total} unpacked bytes: {reason}") from None
        total += len(piece)
        if total > MOST_BYTES:
            raise LapError(f"{path}: unpacks to more than {MOST_BYTES} bytes: cut it to the lap")
        yield piece
        if inflater.eof:
            # another member may follow, and zeros up to a block's end
            data = (inflater.unused_data or packed.read(PIECE)).lstrip(b"\0")
            inflater = None
        else:
            data = inflater.unconsumed_tail or packed.read(PIECE)
    if inflater is not None:
        damage.append(f"cut short: the packed data end after {total} unpacked bytes")
