"""GDB's remote serial protocol as bytes: packets, acknowledgements, the interrupt. Sans-I/O, either side.

Source: Debugging with GDB, appendix E.1 "Overview". Belongs here: framing, escapes and checksums. Never:
what a packet asks for.
"""

from enum import Enum
from typing import NamedTuple

LIMIT = 0x10000
"""Bytes of a packet, escapes included, past which it is given up: four times what the stub announces."""

_ESCAPE = 0x7D
_ESCAPED = frozenset(b"#$}*")


class Mark(Enum):
    """What comes over the line beside packets; DAMAGED stands for a packet that cannot be read."""

    ACK = "+"
    NAK = "-"
    INTERRUPT = "\x03"
    DAMAGED = "damaged"


class Packet(NamedTuple):
    """A packet's payload, checked and unescaped."""

    data: bytes


Event = Packet | Mark

_MARKS = {ord(mark.value): mark for mark in (Mark.ACK, Mark.NAK, Mark.INTERRUPT)}


def encode(data: bytes) -> bytes:
    """The packet that carries `data`."""
    body = bytearray()
    for byte in data:
        if byte in _ESCAPED:
            body += bytes((_ESCAPE, byte ^ 0x20))
        else:
            body.append(byte)
    return b"$%b#%02x" % (bytes(body), sum(body) & 0xFF)


class Decoder:
    """Bytes as they arrive, cut into events; anything outside packets that is no mark is passed over."""

    def __init__(self) -> None:
        self._buffer = bytearray()

    def feed(self, data: bytes) -> list[Event]:
        """The events that `data` completes."""
        self._buffer += data
        events: list[Event] = []
        while self._buffer:
            if self._buffer[0] != ord("$"):
                mark = _MARKS.get(self._buffer.pop(0))
                if mark:
                    events.append(mark)
                continue
            end = self._buffer.find(b"#")
            # An unescaped $ begins a packet: the end of the one before it was lost.
            again = self._buffer.rfind(b"$", 1, end if end >= 0 else None)
            if again > 0:
                del self._buffer[:again]
                events.append(Mark.DAMAGED)
                continue
            if (end if end >= 0 else len(self._buffer)) > LIMIT:
                self._buffer.clear()
                events.append(Mark.DAMAGED)
            if not 0 <= end <= len(self._buffer) - 3:
                break
            body, digits = bytes(self._buffer[1:end]), bytes(self._buffer[end + 1 : end + 3])
            del self._buffer[: end + 3]
            events.append(_packet(body, digits))
        return events


def _packet(body: bytes, digits: bytes) -> Event:
    data = bytearray()
    escaped = False
    for byte in body:
        if byte == _ESCAPE and not escaped:
            escaped = True
            continue
        data.append(byte ^ 0x20 if escaped else byte)
        escaped = False
    intact = digits.lower() == b"%02x" % (sum(body) & 0xFF) and not escaped
    return Packet(bytes(data)) if intact else Mark.DAMAGED
