"""Whether the blocks of an MDF4 file hang together, asked before asammdf follows them.

A damaged link, length or count makes asammdf go in circles, take what memory the file asks for or read less
than was measured and say nothing. Belongs here: the frame of blocks (ASAM MDF 4.1), and that the data are as
long as the records that they are cut into. Never: a value; those are asammdf's.

FIDELITY: files of a logger that was stopped while writing (unfinalised), of column storage (MDF 4.2) and of
other packing than deflate are refused, not read.
"""

import struct
import zlib
from collections.abc import Iterator

from bench.errors import LapError
from bench.laps.can.frames import MOST_BYTES

_BLOCK = struct.Struct("<4s4xQQ")  # name, length, number of links
_HEAD_AT = 64
_CHAINS = {b"##DG", b"##CG", b"##CN", b"##DL", b"##FH", b"##AT", b"##EV", b"##CH"}
"""Blocks whose first link is the next of their kind."""
_DOWN = {b"##CN": 8, b"##CG": 6, b"##CC": 2, b"##CA": 1, b"##EV": 1}
"""Links that lead down or on; those after them may lead back (axes, inverse conversions, parents)."""
_KEPT = (b"##DG", b"##CG", b"##CN")
_DATA_LINK = 5
"""A channel's link to its data, which may be another channel group, also one before its own."""
_VIRTUAL = (3, 6)
_LAST_KIND, _LAST_TYPE = 7, 17
"""asammdf passes over what it does not know."""
_REMOTE_MASTER = 8
_SPARE = 1 << 24
"""Most records of a group whose channels are all computed: nothing in the file pays for them."""


class Blocks:
    """The checked blocks of one file: `data` its bytes, `damage` what is odd and not fatal."""

    def __init__(self, data: bytes, where: str) -> None:
        self.data, self.where = data, where
        self.damage: list[str] = []
        self._identify()
        self._walk()
        for group in self._chain(self.links(_HEAD_AT)[0], b"##DG"):
            self._group(group)

    def links(self, at: int) -> tuple[int, ...]:
        """The links of the block at byte `at`, after a look whether it is one and lies in the file."""
        count = self._block(at)[2]
        return struct.unpack_from(f"<{count}Q", self.data, at + _BLOCK.size)

    def _block(self, at: int) -> tuple[bytes, int, int]:
        if at % 8 or at + _BLOCK.size > len(self.data):
            raise self._error(
                at, f"a link beyond the {len(self.data)} bytes of the file: damaged, or cut short"
            )
        name, length, count = _BLOCK.unpack_from(self.data, at)
        if name[:2] != b"##" or length < _BLOCK.size + 8 * count:
            raise self._error(at, "no block")
        if at + length > len(self.data):
            raise self._error(at, f"{length} bytes, beyond the {len(self.data)} of the file: cut short")
        return name, length, count

    def _error(self, at: int, what: str) -> LapError:
        return LapError(f"{self.where}: MDF block at byte {at}: {what}")

    def _identify(self) -> None:
        if len(self.data) < _HEAD_AT or self.data[:3] not in (b"MDF", b"UnF"):
            raise LapError(f"{self.where}: not an MDF file")
        (version,) = struct.unpack_from("<H", self.data, 28)
        said = f"{version // 100}.{version % 100:02}"
        if not 400 <= version < 500 or self.data[8:16].rstrip(b" \0") != said.encode():
            raise LapError(f"{self.where}: MDF version {said} and {self.data[8:16]!r}, not 4")
        if self.data[:8] != b"MDF     " or any(self.data[60:64]):
            raise LapError(
                f"{self.where}: not finalised: the logger was stopped while writing; "
                "open it with asammdf and save it"
            )
        if self._block(_HEAD_AT)[0] != b"##HD" or self._block(_HEAD_AT)[2] < 6:
            raise self._error(_HEAD_AT, "no header")

    def _walk(self) -> None:
        """Visit every block; LapError if one lies outside, or leads down to itself."""
        seen: set[int] = set()
        above: set[int] = set()
        stack: list[tuple[int, Iterator[int]]] = []
        later: list[int] = [_HEAD_AT]

        def enter(at: int) -> None:
            name, links = self._block(at)[0], self.links(at)
            ends = links[_DOWN.get(name, len(links)) :]
            down = links[: len(links) - len(ends)]
            if name == b"##CN" and len(down) > _DATA_LINK:
                ends = (*ends, down[_DATA_LINK])
                down = (*down[:_DATA_LINK], *down[_DATA_LINK + 1 :])
            if name in _CHAINS and links and links[0] and self._block(links[0])[0] != name:
                raise self._error(at, f"{_text(name)} is followed by {_text(self._block(links[0])[0])}")
            later.extend(link for link in ends if link)
            seen.add(at)
            above.add(at)
            stack.append((at, iter([link for link in down if link])))

        while later:
            start = later.pop()
            if start in seen:
                continue
            enter(start)
            while stack:
                at, links = stack[-1]
                link = next(links, None)
                if link is None:
                    stack.pop()
                    above.discard(at)
                elif link in above:
                    raise self._error(at, f"leads back to byte {link}")
                elif link not in seen:
                    enter(link)
        self._look_for_lost(sorted(seen))

    def _look_for_lost(self, blocks: list[int]) -> None:
        """Report groups and channels between the `blocks` that were visited; other leavings are common."""
        end = _HEAD_AT
        for at in (*blocks, len(self.data)):
            for name in _KEPT:
                lost = self.data.find(name, end, at)
                if lost >= 0 and lost % 8 == 0:
                    self.damage.append(f"MDF block at byte {lost}: a {_text(name)} that no link leads to")
            end = max(end, at + self._block(at)[1]) if at < len(self.data) else at

    def _chain(self, at: int, name: bytes) -> Iterator[int]:
        while at:
            if self._block(at)[0] != name or not self._block(at)[2]:
                raise self._error(at, f"no {_text(name)}")
            yield at
            at = self.links(at)[0]

    def _body(self, at: int, layout: str, links: int) -> tuple[int, ...]:
        """The fields after a block's links, of which it must have at least `links`.

        Its length must be theirs: asammdf tells a block's kind by it.
        """
        name, length, count = self._block(at)
        begin = _BLOCK.size + 8 * count
        size = struct.calcsize(layout)
        if count < links or length < begin + size or (name != b"##DZ" and length != begin + size):
            raise self._error(at, f"{_text(name)} of {count} links in {length} bytes")
        return struct.unpack_from(layout, self.data, at + begin)

    def _group(self, at: int) -> None:
        """Compare the records of a data group's channel groups with its data."""
        (identifier,) = self._body(at, "<B7x", 4)
        _, first, data, *_ = self.links(at)
        there = self._length(data, MOST_BYTES) if data else 0
        needed, several, open_ended = 0, 0, False
        for group in self._chain(first, b"##CG"):
            _, cycles, flags, size, invalid = self._body(group, "<QQH6xII", 6)
            several += 1
            if flags & _REMOTE_MASTER:
                raise self._error(group, "column storage (MDF 4.2), which is not read")
            if flags & 1:  # records of variable length
                open_ended = True
                continue
            record = identifier + size + invalid
            if cycles > (MOST_BYTES // record if record else _SPARE):
                raise self._error(group, f"{cycles} records: more than {MOST_BYTES} bytes")
            needed += cycles * record
            self._channels(self.links(group)[1], size, invalid)
        if several > 1 and not identifier:
            raise self._error(at, f"{several} groups in one, whose records nothing tells apart")
        if needed > there:
            raise self._error(at, f"{there} bytes of data for records of {needed}: cut short")
        if needed < there and not open_ended:
            self.damage.append(
                f"MDF block at byte {at}: {there - needed} bytes beyond its records passed over"
            )

    def _channels(self, first: int, size: int, invalid: int) -> None:
        """Look whether each channel lies within its records of `size` bytes."""
        for at in self._chain(first, b"##CN"):
            kind, _, data, bit, byte, bits, flags, validity = self._body(at, "<4B4I52x", 8)
            if kind > _LAST_KIND or data > _LAST_TYPE:
                raise self._error(at, f"a channel of kind {kind}, data type {data}")
            if kind not in _VIRTUAL and byte + (bit + bits + 7) // 8 > size:
                raise self._error(at, f"a channel beyond its record of {size} bytes")
            if flags & 2 and validity >= 8 * invalid:
                raise self._error(at, f"validity bit {validity} of {8 * invalid}")
            inner = self.links(at)[1]
            if inner and self._block(inner)[0] == b"##CN":
                self._channels(inner, size, invalid)

    def _length(self, at: int, room: int) -> int:
        """Bytes of data in a data block or a list of them, unpacked, which a packed one is to see."""
        name, length, count = self._block(at)
        if name in (b"##DT", b"##SD"):
            total = length - _BLOCK.size
        elif name == b"##DZ":
            total = self._packed(at, room)
        elif name == b"##HL":
            total = self._length(self.links(at)[0], room) if count and self.links(at)[0] else 0
        elif name == b"##DL":
            total = 0
            for part in self._chain(at, name):
                for link in self.links(part)[1:]:
                    total += self._length(link, room - total) if link else 0
        else:
            raise self._error(at, f"data in {_text(name)}, which is not read")
        if total > room:
            raise self._error(at, f"more than {MOST_BYTES} bytes of data: cut the file to the lap")
        return total

    def _packed(self, at: int, room: int) -> int:
        kind, column, size, packed = self._body(at, "<2xBxIQQ", 0)
        begin = at + _BLOCK.size + 24
        if kind not in (0, 1) or (kind == 1 and not column):
            raise self._error(at, f"data packed by method {kind}, which is not read")
        if size > room or begin + packed > at + self._block(at)[1]:
            raise self._error(at, f"{packed} bytes that are to unpack to {size}")
        try:
            got = len(zlib.decompressobj().decompress(self.data[begin : begin + packed], size + 1))
        except zlib.error as error:
            raise self._error(at, f"data that do not unpack: {error}") from None
        if got != size:
            raise self._error(at, f"{got} bytes unpacked, not {size}")
        return size


def _text(name: bytes) -> str:
    return name.decode("ascii", "backslashreplace")
