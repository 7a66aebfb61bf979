"""MAVLink packets of one datagram: found, checked, unpacked; messages packed; records of a .tlog.

Message layouts come from pymavlink's `common` dialect. Its connection classes open what they are given, and
its parser trusts an environment variable that lets damaged packets through: neither is used.
FIDELITY: signatures are not checked, a signed packet counts as an unsigned one.
Belongs here: framing, checksums, layouts. Never: what a message asks for, a socket, a clock.
"""

import struct
from collections.abc import Mapping
from functools import lru_cache
from typing import Any, NamedTuple

from bench.errors import MavlinkError

SYSTEM, COMPONENT = 1, 1
"""The bench's own: ground stations take component 1, the autopilot, for the vehicle."""

_HEAD = {0xFE: 6, 0xFD: 10}
"""Start byte of version 1 and 2 -> bytes before the payload."""
_TWO = 0xFD
_SIGNED, _SIGNATURE = 0x01, 13
_CRC = 2


class Message(NamedTuple):
    """A packet whose checksum is right. fields: by name, of the two COMMAND_*; empty for others."""

    name: str
    system: int
    component: int
    fields: Mapping[str, Any]


@lru_cache
def common() -> Any:
    """The dialect's module; MavlinkError with the command that installs it where pymavlink is missing."""
    try:
        from pymavlink.dialects.v20 import common as dialect
    except ImportError:
        raise MavlinkError("needs pymavlink: pip install 'strokebench[mavlink]'") from None
    return dialect


def split(datagram: bytes) -> tuple[list[bytes], int]:
    """The packets that stand one after the other in `datagram`, and 1 if its rest is none, 0 otherwise."""
    found: list[bytes] = []
    at = 0
    while at < len(datagram):
        size = _size(datagram[at : at + 3])
        if size is None or at + size > len(datagram):
            return found, 1
        found.append(datagram[at : at + size])
        at += size
    return found, 0


def unpack(packet: bytes) -> Message | None:
    """The message in one of `split`'s packets; None if it is damaged or of a type the dialect lacks."""
    head = _HEAD[packet[0]]
    two = packet[0] == _TWO
    end = head + packet[1]
    kind = int.from_bytes(packet[7:10], "little") if two else packet[5]
    message = common().mavlink_map.get(kind)
    if message is None:
        return None
    crc = common().x25crc(packet[1:end])
    crc.accumulate(bytes((message.crc_extra,)))
    if crc.crc != int.from_bytes(packet[end : end + _CRC], "little"):
        return None
    system, component = packet[5:7] if two else packet[3:5]
    fields: Mapping[str, Any] = {}
    if message.msgname in ("COMMAND_LONG", "COMMAND_INT"):
        size = message.unpacker.size
        if not two and packet[1] != size:
            return None  # only version 2 leaves out zeros at the end
        payload = packet[head:end].ljust(size, b"\0")[:size]
        fields = dict(zip(message.ordered_fieldnames, message.unpacker.unpack(payload), strict=True))
    return Message(message.msgname, system, component, fields)


class Packer:
    """Numbers and packs the messages of one sender, version 2."""

    def __init__(self) -> None:
        self._link = common().MAVLink(None, SYSTEM, COMPONENT)

    def pack(self, message: Any) -> bytes:
        """The packet of a message of the dialect."""
        packet = bytes(message.pack(self._link))
        self._link.seq = (self._link.seq + 1) & 0xFF
        return packet


def record(t_us: int, packet: bytes) -> bytes:
    """One record of a .tlog: microseconds since 1970, big-endian, and the packet."""
    return struct.pack(">Q", t_us) + packet


def _size(head: bytes) -> int | None:
    """Bytes of the packet that begins with `head`, None if none does."""
    if len(head) < 3 or head[0] not in _HEAD:
        return None
    plain = _HEAD[head[0]] + head[1] + _CRC
    if head[0] != _TWO:
        return plain
    # flags that one does not know say that the packet cannot be read
    return None if head[2] & ~_SIGNED else plain + _SIGNATURE * (head[2] & _SIGNED)
