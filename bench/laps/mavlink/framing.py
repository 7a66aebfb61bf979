"""MAVLink packets in a telemetry log: found, checked, unpacked and packed, many at once.

A .tlog is records of 8 bytes of time, big-endian microseconds since 1970, and one MAVLink packet, version 1
or 2. Message layouts come from pymavlink's ardupilotmega dialect, which holds the common one; nothing else of
pymavlink is used, for its connection classes open what they are given, and print.

Belongs here: framing, checksums, layouts. Never: which message is which channel.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.errors import LapError
from targets.jit import njit

STAMP = 8
_V2 = 0xFD
_UNKNOWN = -1
_TYPES = {letter: np.dtype(letter).newbyteorder("<") for letter in "bBhHiIqQfd"}
"""The dialect's letters for types, which are struct's, little-endian."""


@dataclass(frozen=True)
class Packets:
    """The packets of a log, in order; all arrays (packets,).

    start, end: bytes of the record, its time included. kind: message id; source: 256 x system + component;
    payload: the payload's first byte, length: how many it has. Unknown ids are among them.
    """

    start: NDArray[np.int64]
    end: NDArray[np.int64]
    kind: NDArray[np.int64]
    source: NDArray[np.int64]
    payload: NDArray[np.int64]
    length: NDArray[np.int64]


@dataclass(frozen=True)
class Dialect:
    """Message classes of pymavlink by id and by name.

    extra, longest: int16 by id, the checksum's seed and the payload's bytes; -1 for ids that are none.
    """

    by_id: Mapping[int, Any]
    by_name: Mapping[str, Any]
    extra: NDArray[np.int16]
    longest: NDArray[np.int16]


@lru_cache
def dialect() -> Dialect:
    """The dialect; LapError with the command that installs it where pymavlink is missing."""
    try:
        from pymavlink.dialects.v20 import ardupilotmega
    except ImportError:
        raise LapError("MAVLink logs need pymavlink: pip install 'strokebench[mavlink]'") from None
    by_id = ardupilotmega.mavlink_map
    extra, longest = np.full((2, max(by_id) + 1), _UNKNOWN, dtype=np.int16)
    for kind, message in by_id.items():
        extra[kind], longest[kind] = message.crc_extra, message.unpacker.size
    return Dialect(by_id, {message.msgname: message for message in by_id.values()}, extra, longest)


def layout(message: Any) -> np.dtype:
    """The payload of a message class as a structured dtype, extension fields included."""
    codes = message.native_format.decode().lstrip("<")
    fields: list[Any] = []
    for name, code, count in zip(message.ordered_fieldnames, codes, message.array_lengths, strict=True):
        if code == "c":
            fields.append((name, f"S{count or 1}"))
        else:
            fields.append((name, _TYPES[code], (count,)) if count else (name, _TYPES[code]))
    return np.dtype(fields)


def find(data: NDArray[np.uint8]) -> Packets:
    """All packets of a log whose checksum is right, and packets of unknown ids where others surround them."""
    start, end = _find(data, dialect().extra, dialect().longest)
    head = start + STAMP
    # the shortest packet, of version 1, has 8 bytes; what is read beyond its end is not used
    byte = [data[np.minimum(head + k, len(data) - 1)].astype(np.int64) for k in range(10)]
    two = byte[0] == _V2
    kind = np.where(two, byte[7] | byte[8] << 8 | byte[9] << 16, byte[5])
    source = np.where(two, byte[5] << 8 | byte[6], byte[3] << 8 | byte[4])
    return Packets(start, end, kind, source, head + np.where(two, 10, 6), byte[1])


def unpack(data: NDArray[np.uint8], packets: Packets, chosen: NDArray[np.int64], kind: int) -> NDArray:
    """The payloads of the packets `chosen`, all of message `kind`, as a structured array (chosen,).

    Bytes that were not sent are zero (version 2 leaves out zeros at the end), bytes beyond the layout, of a
    newer dialect, are left out.
    """
    form = layout(dialect().by_id[kind])
    rows = np.zeros((len(chosen), form.itemsize), dtype=np.uint8)
    lengths = np.minimum(packets.length[chosen], form.itemsize)
    for byte in range(int(lengths.max(initial=0))):
        sent = np.flatnonzero(lengths > byte)
        rows[sent, byte] = data[packets.payload[chosen[sent]] + byte]
    return rows.view(form)[:, 0]


def pack(name: str, t_us: NDArray[np.int64], fields: NDArray, first: int, sender: int) -> bytes:
    """Records of message `name`, version 2: t_us (messages,), fields structured as `layout` says (messages,).

    first: sequence number of the first; sender: 256 x system + component.
    """
    message = dialect().by_name[name]
    payloads = fields.view(np.uint8).reshape(len(fields), -1)
    room = np.zeros(payloads.size + len(payloads) * (STAMP + 12), dtype=np.uint8)
    used = _pack(room, t_us, payloads, message.id, message.crc_extra, first, sender)
    return room[:used].tobytes()


@njit(cache=True)
def _crc(data: Any, first: int, last: int, extra: int) -> int:
    # CRC-16/MCRF4XX over what follows the start byte, then the seed of the message's layout
    crc = 0xFFFF
    for k in range(first, last + 1):
        byte = data[k] if k < last else extra
        low = (byte ^ crc) & 0xFF
        low = (low ^ (low << 4)) & 0xFF
        crc = (crc >> 8) ^ (low << 8) ^ (low << 3) ^ (low >> 4)
    return crc


@njit(cache=True)
def _find(data: Any, extra: Any, longest: Any) -> Any:
    size = len(data)
    starts = np.empty(size // 16 + 1, np.int64)  # the shortest record: time, 6 bytes of head, checksum
    ends = np.empty(size // 16 + 1, np.int64)
    count = 0
    at = 0
    synchronous = True
    while at + 16 <= size:
        head = at + 8
        length = np.int64(data[head + 1])
        body: Any = 0
        kind: Any = 0
        signature: Any = 0
        if data[head] == 0xFE:
            body, kind = head + 6, np.int64(data[head + 5])
        elif data[head] == 0xFD and data[head + 2] <= 1 and head + 10 <= size:
            # the one incompatibility flag there is: 13 bytes of signature, which are not checked
            body = head + 10
            kind = np.int64(data[head + 7]) | np.int64(data[head + 8]) << 8 | np.int64(data[head + 9]) << 16
            signature = 13 * np.int64(data[head + 2])
        end = body + length + 2 + signature
        good: Any = False
        if body > 0 and end <= size:
            if kind < len(extra) and extra[kind] >= 0:
                # Amid garbage a payload longer than its message is none, which saves most checksums; in step
                # it may be the message of a newer dialect.
                if not synchronous and length > longest[kind]:
                    at += 1
                    continue
                sent = np.int64(data[body + length]) | np.int64(data[body + length + 1]) << 8
                good = _crc(data, head + 1, body + length, np.int64(extra[kind])) == sent
            elif synchronous:
                # Its checksum's seed is not known: it is believed where the next packet begins as it should.
                good = end == size or (end + 8 < size and (data[end + 8] == 0xFE or data[end + 8] == 0xFD))
        synchronous = good
        if good:
            starts[count], ends[count] = at, end
            count += 1
            at = end
        else:
            at += 1
    return starts[:count].copy(), ends[:count].copy()


@njit(cache=True)
def _pack(room: Any, t_us: Any, payloads: Any, kind: int, extra: int, first: int, sender: int) -> int:
    at = 0
    for k in range(len(payloads)):
        length = payloads.shape[1]
        while length > 1 and payloads[k, length - 1] == 0:
            length -= 1
        for byte in range(8):
            room[at + byte] = (t_us[k] >> (56 - 8 * byte)) & 0xFF
        head = at + 8
        room[head], room[head + 1] = 0xFD, length
        room[head + 4] = (first + k) & 0xFF
        room[head + 5], room[head + 6] = sender >> 8, sender & 0xFF
        room[head + 7], room[head + 8], room[head + 9] = kind & 0xFF, (kind >> 8) & 0xFF, kind >> 16
        room[head + 10 : head + 10 + length] = payloads[k, :length]
        end = head + 10 + length
        crc = _crc(room, head + 1, end, extra)
        room[end], room[end + 1] = crc & 0xFF, crc >> 8
        at = end + 2
    return at
