"""The container: header, segments, sections and symbols of a 32-bit ARM ELF file.

Read here rather than by a library because the file may be anybody's: every table is held to the file's size
before it is walked, so that damage of any kind costs one FirmwareError and no more time or memory than the
file has bytes. Belongs here: the file format. Never: what a memory address means to the MCU.
"""

import struct
from typing import NamedTuple

import numpy as np

from targets.errors import FirmwareError

ET_REL, ET_EXEC = 1, 2
PT_LOAD, PF_X = 1, 1
SHT_NULL, SHT_SYMTAB, SHT_STRTAB, SHT_NOBITS, SHT_ATTRIBUTES = 0, 2, 3, 8, 0x70000003
SHF_ALLOC, SHF_EXECINSTR, SHF_COMPRESSED = 2, 4, 0x800
STT_NOTYPE, STT_OBJECT, STT_FUNC, STT_SECTION, STT_FILE = 0, 1, 2, 3, 4
STB_GLOBAL = 1
EM_ARM = 40

MOST_SEGMENTS = 256

_TYPES = {ET_REL: "not linked: a relocatable object", 3: "not linked to addresses: a shared object"}
_MACHINES = {2: "SPARC", 3: "x86", 8: "MIPS", 20: "PowerPC", EM_ARM: "ARM", 62: "x86-64", 83: "AVR"} | {
    94: "Xtensa",
    105: "MSP430",
    183: "AArch64",
    243: "RISC-V",
}
_HEADER = struct.Struct("<16sHHIIIIIHHHHHH")
_SEGMENT = struct.Struct("<8I")
_SECTION = struct.Struct("<10I")
_SYMBOL = np.dtype(
    {
        "names": ["name", "value", "size", "info", "other", "shndx"],
        "formats": ["<u4", "<u4", "<u4", "u1", "u1", "<u2"],
    }
)


class Segment(NamedTuple):
    """A PT_LOAD program header."""

    offset: int
    vaddr: int
    paddr: int
    filesz: int
    memsz: int
    flags: int


class Section(NamedTuple):
    """A section header with its name."""

    name: str
    kind: int
    flags: int
    address: int
    offset: int
    size: int
    link: int


class Symbol(NamedTuple):
    """An entry of the symbol table; `value` as it stands there, Thumb bit included."""

    name: str
    value: int
    size: int
    kind: int
    bind: int
    section: int


class Elf(NamedTuple):
    """A file whose tables have been found whole."""

    data: bytes
    segments: list[Segment]
    sections: list[Section]

    def content(self, section: Section) -> bytes:
        """The bytes of a section in the file."""
        return (
            b"" if section.kind == SHT_NOBITS else self.data[section.offset : section.offset + section.size]
        )

    def named(self, name: str) -> Section | None:
        """The first section called `name`."""
        return next((section for section in self.sections if section.name == name), None)


def read(data: bytes, source: str) -> Elf:
    """The tables of a linked ELF file for 32-bit little-endian ARM; FirmwareError for any other file."""
    if not data.startswith(b"\x7fELF"):
        raise FirmwareError(f"{source}: not an ELF file")
    if len(data) < _HEADER.size:
        raise FirmwareError(f"{source}: damaged ELF file (truncated within its header)")
    ident, kind, machine, _, _, phoff, shoff, _, _, phentsize, phnum, shentsize, shnum, shstrndx = (
        _HEADER.unpack_from(data)
    )
    if machine != EM_ARM or ident[4] != 1 or ident[5] != 1:
        bits = {1: "32-bit", 2: "64-bit"}.get(ident[4], f"class {ident[4]}")
        order = {1: "little-endian", 2: "big-endian"}.get(ident[5], f"byte order {ident[5]}")
        built = f"{bits} {order} {_MACHINES.get(machine, f'machine {machine}')}"
        raise FirmwareError(f"{source}: built for {built}, not for a little-endian ARM Cortex-M4")
    if kind != ET_EXEC:
        raise FirmwareError(f"{source}: {_TYPES.get(kind, f'not a firmware: an ELF file of type {kind}')}")
    segments = [
        Segment(offset, vaddr, paddr, filesz, memsz, flags)
        for what, offset, vaddr, paddr, filesz, memsz, flags, _ in _table(
            data, source, "program headers", phoff, phnum, phentsize, _SEGMENT
        )
        if what == PT_LOAD
    ]
    if len(segments) > MOST_SEGMENTS:
        raise FirmwareError(f"{source}: damaged ELF file ({len(segments)} segments)")
    for segment in segments:
        if segment.offset + segment.filesz > len(data):
            raise FirmwareError(f"{source}: truncated within the segment at {segment.paddr:#010x}")
        if segment.filesz > segment.memsz:
            raise FirmwareError(
                f"{source}: damaged ELF file ({segment.filesz} bytes for {segment.memsz} of memory "
                f"at {segment.paddr:#010x})"
            )
    rows = _table(data, source, "section headers", shoff, shnum if shoff else 0, shentsize, _SECTION)
    return Elf(data, segments, _sections(data, source, rows, shstrndx))


def _table(
    data: bytes, source: str, what: str, offset: int, count: int, size: int, row: struct.Struct
) -> list[tuple[int, ...]]:
    if count and size < row.size:
        raise FirmwareError(f"{source}: damaged ELF file ({what} of {size} bytes each)")
    if count and offset + count * size > len(data):
        raise FirmwareError(f"{source}: truncated: its {what} lie beyond the end of the file")
    return [row.unpack_from(data, offset + k * size) for k in range(count)]


def _sections(data: bytes, source: str, rows: list[tuple[int, ...]], names_at: int) -> list[Section]:
    for number, (_, kind, _, _, offset, size, *_) in enumerate(rows):
        if kind not in (SHT_NULL, SHT_NOBITS) and offset + size > len(data):
            raise FirmwareError(f"{source}: truncated within section {number}")
    names = b""
    if names_at < len(rows) and rows[names_at][1] == SHT_STRTAB:
        _, _, _, _, offset, size, *_ = rows[names_at]
        names = data[offset : offset + size]
    return [
        Section(text(names, name), kind, flags, address, offset, size, link)
        for name, kind, flags, address, offset, size, link, *_ in rows
    ]


def text(table: bytes, at: int, most: int = 1024) -> str:
    """The zero-terminated string at `at`, of at most `most` bytes, fit to be shown."""
    end = table.find(b"\0", at, at + most)
    return readable(table[at : end if end >= 0 else at + most])


def readable(content: bytes) -> str:
    """UTF-8 with a question mark for what cannot be printed."""
    string = content.decode("utf-8", "replace")
    return string if string.isprintable() else "".join(c if c.isprintable() else "?" for c in string)


def symbols(elf: Elf, source: str) -> list[Symbol]:
    """The symbol table, empty if the file has been stripped."""
    found: list[Symbol] = []
    room = 8 * len(elf.data)  # names may share their ends, but not without limit
    for section in elf.sections:
        if section.kind != SHT_SYMTAB:
            continue
        if section.link >= len(elf.sections):
            raise FirmwareError(f"{source}: damaged ELF file (symbols without names)")
        names = elf.content(elf.sections[section.link])
        table = np.frombuffer(elf.content(section), dtype=_SYMBOL, count=section.size // _SYMBOL.itemsize)
        for at, value, size, info, _, shndx in table.tolist():
            name = text(names, at)
            room -= len(name)
            if room < 0:
                raise FirmwareError(f"{source}: damaged ELF file (symbol names without end)")
            found.append(Symbol(name, value, size, info & 0xF, info >> 4, shndx))
    return found


def uleb(data: bytes, at: int) -> tuple[int, int]:
    """An unsigned LEB128 number of up to 64 bits, and where it ends; IndexError if it does not."""
    value = 0
    for shift in range(0, 70, 7):
        byte = data[at]
        at += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value, at
    raise IndexError("number without end")
