"""ASAM MDF4 files of ours: what makes the same contents the same bytes, for recordings and laps alike.

Belongs here: what asammdf stamps and how it is taken back. Never: what a file is about.
"""

import struct
from datetime import UTC, datetime
from pathlib import Path

START = datetime(1970, 1, 1, tzinfo=UTC)
"""When every measurement begins: time 0, no day."""


def forget_save_time(part: Path) -> None:
    """Zero the time in the file history, which says when the file was saved.

    MDF 4.1: the header block at 64 links the first history block at its byte 32; that one holds from byte 40
    the time, the offsets of the time zone and of daylight saving, and the flags that say what they mean.
    """
    content = bytearray(part.read_bytes())
    (history,) = struct.unpack_from("<Q", content, 64 + 32)
    struct.pack_into("<QhhB", content, history + 40, 0, 0, 0, 0)
    part.write_bytes(content)
