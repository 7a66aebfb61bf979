"""What travels between a hub and its clients: records of bytes, each preceded by its length.

Belongs here: the layout, and whether bytes keep to it. Never: a socket, a queue, python-can.

A record is a head of 16 bytes and what follows it. The head, little-endian: length of the whole record, kind,
flags, DLC (a byte each), identifier (four), time in ns since 1970 (eight). A frame's data or a notice's text
follows. Both sides speak the same layout; a client leaves the time 0 and the hub fills it in.
"""

from collections.abc import Callable, Iterator
from struct import Struct
from typing import NamedTuple

from bench.errors import BusError

INTERFACE = "strokebench"
"""Its name in python-can."""

VERSION = 1

HEAD = Struct("<BBBBIQ")
_TIME = Struct("<Q")
_TIME_AT = 8
_FLAGS_AT = 2

HELLO = 1
"""Client to hub, once: DLC is the version, identifier the bit rate asked for (0: any), flags OWN."""
WELCOME = 2
"""Hub to client, the answer: DLC is the version, identifier the bit rate (0: none), time the process id."""
FRAME = 3
REFUSED = 4
"""Hub to client, and its last word: text says why."""
HELD_UP = 5
"""Hub to client: text names who keeps the hub from taking frames; without text, nobody does any more."""

EXTENDED, REMOTE, ERROR, FD, BRS, ESI, OWN = (1 << bit for bit in range(7))
"""Flags. OWN: in a frame, that its receiver has sent it; in HELLO, that the client wants to hear those."""

FD_LENGTHS = frozenset((*range(9), 12, 16, 20, 24, 32, 48, 64))
LONGEST = HEAD.size + 64
"""Of a client's records."""
_TEXT_BYTES = 255 - HEAD.size


class WireError(BusError):
    """Bytes that are no record, or one that has no place here."""


class Record(NamedTuple):
    """One record, taken apart."""

    kind: int
    flags: int
    dlc: int
    id: int
    t_ns: int
    body: bytes


def pack(
    kind: int, flags: int = 0, dlc: int = 0, identifier: int = 0, t_ns: int = 0, body: bytes = b""
) -> bytes:
    """A record's bytes."""
    return HEAD.pack(HEAD.size + len(body), kind, flags, dlc, identifier, t_ns) + body


def notice(kind: int, text: str) -> bytes:
    """A record of words; they are cut where a record ends."""
    return pack(kind, body=text.encode(errors="replace")[:_TEXT_BYTES])


def text(record: Record) -> str:
    """The words of a notice."""
    return record.body.decode(errors="replace")


def whole(buffer: bytes | bytearray, at: int = 0) -> Iterator[tuple[int, Record]]:
    """The whole records of `buffer` from `at` on, each with its end; WireError for a length too short."""
    while len(buffer) - at >= HEAD.size:
        length, kind, flags, dlc, identifier, t_ns = HEAD.unpack_from(buffer, at)
        if length < HEAD.size:
            raise WireError(f"a record of {length} bytes, which is no record")
        if len(buffer) - at < length:
            return
        body = bytes(buffer[at + HEAD.size : at + length])
        at += length
        yield at, Record(kind, flags, dlc, identifier, t_ns, body)


def fault(flags: int, dlc: int, identifier: int, length: int, classic: bool = False) -> str | None:
    """What is wrong with a frame of `length` data bytes; None: nothing. classic: FD frames are wrong."""
    if identifier >= (1 << 29 if flags & (EXTENDED | ERROR) else 1 << 11):
        return f"identifier {identifier:#x} has more than {29 if flags & EXTENDED else 11} bits"
    if flags & FD:
        if classic:
            return "a timed bus carries no FD frames"
        if flags & (REMOTE | ERROR):
            return "an FD frame is neither a remote nor an error frame"
        if length not in FD_LENGTHS:
            return f"an FD frame has no {length} bytes"
    elif flags & (BRS | ESI):
        return "only an FD frame has BRS or ESI"
    elif length > 8 or dlc > 8:
        return f"a classic frame has no {max(length, dlc)} bytes"
    if length != (0 if flags & REMOTE else dlc):
        return f"{length} bytes of data at DLC {dlc}"
    return None


def stamp(buffer: bytearray, clock: Callable[[], int]) -> int:
    """Write the time into each whole frame at the head of `buffer`; where the last one ends.

    clock: ns since 1970, asked once for each. Raises WireError if the first record is no client's frame.
    """
    at, size, head = 0, len(buffer), HEAD.size
    while size - at >= head:
        length, kind, flags, dlc, identifier, _ = HEAD.unpack_from(buffer, at)
        if not head <= length <= LONGEST or kind != FRAME or flags >= OWN:
            wrong: str | None = (
                f"a record of kind {kind}, flags {flags:#x} and {length} bytes, which is no frame"
            )
        else:
            wrong = fault(flags, dlc, identifier, length - head)
        if wrong and not at:
            raise WireError(wrong)
        if wrong or size - at < length:
            break
        _TIME.pack_into(buffer, at + _TIME_AT, clock())
        at += length
    return at


def set_time(record: bytearray, t_ns: int) -> None:
    """Write another time into the one record."""
    _TIME.pack_into(record, _TIME_AT, t_ns)


def own(batch: bytes | bytearray) -> bytearray:
    """The frames of `batch`, each marked as its receiver's own."""
    marked, at = bytearray(batch), 0
    while at < len(marked):
        marked[at + _FLAGS_AT] |= OWN
        at += marked[at]
    return marked
