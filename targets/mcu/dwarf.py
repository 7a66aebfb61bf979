"""Source lines from DWARF: which file and line an instruction belongs to (section 6.2; versions 2 to 5).

Only .debug_line is read: its units stand for themselves, and a damaged one costs its own lines. Every count
is held to the bytes that are there, so a hostile table takes no longer than an honest one of its size.
"""

import posixpath
import struct
import zlib
from bisect import bisect_right
from contextlib import suppress
from typing import NamedTuple

from targets.mcu.elf import SHF_COMPRESSED, SHT_NOBITS, Elf, readable, text, uleb

MOST_BYTES, MOST_FILES = 16 << 20, 1 << 16
"""A compressed section is unpacked up to the first, a unit's files are listed up to the second."""

_Row = tuple[int, int, str]


class Lines(NamedTuple):
    """Ranges of addresses [start, end) with the line each belongs to, in order of address."""

    starts: list[int]
    ends: list[int]
    places: list[str]

    def at(self, address: int) -> str:
        """`file:line` of the instruction at `address`, '' if it is unknown."""
        k = bisect_right(self.starts, address) - 1
        return self.places[k] if k >= 0 and address < self.ends[k] else ""


def lines(elf: Elf, spans: tuple[tuple[int, int], ...]) -> Lines:
    """The line table of the code in `spans`; empty without debug data."""
    rows: list[_Row] = []
    program = _section(elf, ".debug_line")
    strings = {0x1F: _section(elf, ".debug_line_str"), 0x0E: _section(elf, ".debug_str")}
    at = 0
    while at + 4 <= len(program):
        (length,) = struct.unpack_from("<I", program, at)
        wide = length == 0xFFFFFFFF
        if wide:
            if at + 12 > len(program):
                break
            (length,) = struct.unpack_from("<Q", program, at + 4)
        begin = at + (12 if wide else 4)
        end = min(begin + length, len(program))
        with suppress(IndexError, struct.error, ValueError):  # the lines before the damage stand
            _unit(program[begin:end], wide, strings, rows)
        at = begin + length
    # Functions that the linker dropped keep their rows, at address 0.
    kept = sorted(row for row in rows if inside(spans, row[0]))
    return Lines([row[0] for row in kept], [row[1] for row in kept], [row[2] for row in kept])


def inside(spans: tuple[tuple[int, int], ...], address: int) -> bool:
    """Whether `address` lies in one of the ordered, disjoint ranges [start, end)."""
    k = bisect_right(spans, (address, 1 << 32)) - 1
    return k >= 0 and address < spans[k][1]


def _section(elf: Elf, name: str) -> bytes:
    section = elf.named(name)
    if section is None or section.kind == SHT_NOBITS:
        return b""
    content = elf.content(section)
    if section.flags & SHF_COMPRESSED:  # behind a header of type, size and alignment
        try:
            return zlib.decompressobj().decompress(content[12:], MOST_BYTES)
        except zlib.error:
            return b""
    return content


class _Header(NamedTuple):
    minimum: int
    line_base: int
    line_range: int
    lengths: bytes
    files: list[str]
    program: int


def _unit(data: bytes, wide: bool, strings: dict[int, bytes], rows: list[_Row]) -> None:
    """Run one unit's line number program."""
    head = _header(data, wide, strings)
    at = head.program
    address, file, line = 0, 1, 1
    begun: tuple[int, int, int] | None = None  # address, file, line of the row that is open

    def emit(closing: bool) -> None:
        nonlocal begun
        if begun and (closing or begun[1:] != (file, line)):
            start, of, number = begun
            if start < address and number and 0 <= of < len(head.files):
                rows.append((start, address, f"{head.files[of]}:{number}"))
            begun = None
        if begun is None and not closing:
            begun = (address, file, line)

    opcodes = len(head.lengths) + 1
    while at < len(data):
        code = data[at]
        at += 1
        if code >= opcodes:  # special: both at once, and a row
            step, more = divmod(code - opcodes, head.line_range)
            address = (address + step * head.minimum) & 0xFFFFFFFF
            line += head.line_base + more
            emit(False)
        elif code == 0:
            length, at = uleb(data, at)
            what = data[at]
            if what == 1:  # end of sequence
                emit(True)
                address, file, line = 0, 1, 1
            elif what == 2:
                address = int.from_bytes(data[at + 1 : at + length], "little") & 0xFFFFFFFF
            at += length
        elif code == 1:
            emit(False)
        elif code == 2:
            step, at = uleb(data, at)
            address = (address + step * head.minimum) & 0xFFFFFFFF
        elif code == 3:
            step, after = uleb(data, at)
            sign = 1 << (7 * (after - at))
            line, at = line + (step - sign if step & sign >> 1 else step), after
        elif code == 4:
            file, at = uleb(data, at)
        elif code == 8:
            address = (address + (255 - opcodes) // head.line_range * head.minimum) & 0xFFFFFFFF
        elif code == 9:
            address = (address + struct.unpack_from("<H", data, at)[0]) & 0xFFFFFFFF
            at += 2
        else:
            for _ in range(head.lengths[code - 1]):
                _, at = uleb(data, at)


def _header(data: bytes, wide: bool, strings: dict[int, bytes]) -> _Header:
    (version,) = struct.unpack_from("<H", data)
    if not 2 <= version <= 5:
        raise ValueError(f"version {version}")
    at = 4 if version == 5 else 2  # address and segment selector sizes came with version 5
    (length,) = struct.unpack_from("<Q" if wide else "<I", data, at)
    at += 8 if wide else 4
    program = at + length
    minimum = data[at]
    at += 1 if version < 4 else 2  # operations per instruction came with version 4
    line_base, line_range, opcodes = struct.unpack_from("<xbBB", data, at)
    at += 4
    if line_range == 0 or opcodes == 0:
        raise ValueError("no line range")
    lengths = data[at : at + opcodes - 1]
    at += opcodes - 1
    if version == 5:
        folders, at = _entries(data, at, wide, strings)
        names, at = _entries(data, at, wide, strings)
    else:
        folders, names, at = _old_tables(data, at)
    paths = [path for path, _ in folders]
    files = [_path(name, folder, paths) for name, folder in names]
    return _Header(minimum, line_base, line_range, lengths, files, program)


def _path(name: str, folder: int, folders: list[str]) -> str:
    """As short as the compiler was called with: folder 0 is the one it ran in."""
    if folder == 0 or folder >= len(folders):
        return posixpath.normpath(name)
    path = posixpath.normpath(posixpath.join(folders[folder], name))
    return path.removeprefix(posixpath.normpath(folders[0]) + "/") if folders[0] else path


def _old_tables(data: bytes, at: int) -> tuple[list[tuple[str, int]], list[tuple[str, int]], int]:
    """Folders and files before version 5; the first of each is number 1."""
    folders: list[tuple[str, int]] = [("", 0)]
    files: list[tuple[str, int]] = [("", 0)]
    while data[at]:
        end = data.index(0, at)
        folders.append((readable(data[at:end]), 0))
        at = end + 1
    at += 1
    while data[at]:
        end = data.index(0, at)
        folder, after = uleb(data, end + 1)
        files.append((readable(data[at:end]), folder))
        _, after = uleb(data, after)  # time
        _, at = uleb(data, after)  # size
    return folders, files, at + 1


_FIXED = {0x0B: 1, 0x05: 2, 0x06: 4, 0x07: 8, 0x1E: 16}  # data1, data2, data4, data8, data16


def _entries(
    data: bytes, at: int, wide: bool, strings: dict[int, bytes]
) -> tuple[list[tuple[str, int]], int]:
    """Folders or files of version 5 (section 6.2.4.1): their paths and the numbers of their folders."""
    formats = []
    count = data[at]
    at += 1
    for _ in range(count):
        content, at = uleb(data, at)
        form, at = uleb(data, at)
        formats.append((content, form))
    count, at = uleb(data, at)
    if count > MOST_FILES or (count and not formats):
        raise ValueError(f"{count} entries")
    entries = []
    for _ in range(count):
        path, folder = "", 0
        for content, form in formats:
            value: str | int = 0
            if form in strings:
                (offset,) = struct.unpack_from("<Q" if wide else "<I", data, at)
                value = text(strings[form], offset)
                at += 8 if wide else 4
            elif form == 0x08:
                end = data.index(0, at)
                value = readable(data[at:end])
                at = end + 1
            elif form in _FIXED:
                value = int.from_bytes(data[at : at + _FIXED[form]], "little")
                at += _FIXED[form]
            elif form == 0x0F:
                value, at = uleb(data, at)
            else:
                raise ValueError(f"form {form:#x}")
            if content == 1:
                path = str(value)
            elif content == 2:
                folder = int(value)
        entries.append((path, folder))
    return entries, at
