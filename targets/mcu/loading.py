"""What of an ELF file goes where: its bytes into the MCU's memories, its symbols to functions and code."""

from bisect import bisect_left
from itertools import pairwise
from typing import NamedTuple

from targets.errors import FirmwareError
from targets.mcu import elf
from targets.mcu.dwarf import inside
from targets.mcu.elf import Elf, Symbol
from targets.mcu.memory_map import FLASH, FLASH_SIZE, holds, in_flash

Spans = tuple[tuple[int, int], ...]
Contents = tuple[tuple[int, bytes], ...]


class Piece(NamedTuple):
    """Bytes of the file and where they go.

    load: the address at which a flash tool or a debugger puts them. run: the address at which the program
    expects them, another one where its start-up code copies them.
    """

    load: int
    run: int
    offset: int
    size: int


def pieces(file: Elf, source: str) -> list[Piece]:
    """What is to be loaded, by address; FirmwareError if anything would lie outside memory, or twice."""
    held = [s for s in file.sections if s.flags & elf.SHF_ALLOC and s.size]
    filled = [s for s in held if s.kind != elf.SHT_NOBITS]
    found = []
    for segment in file.segments:
        first, last = segment.offset, segment.offset + segment.filesz
        covered = [s for s in filled if first <= s.offset < last]
        if filled and segment.filesz:
            # Linkers extend a segment over the file's own headers where the pages allow it.
            first = min((s.offset for s in covered), default=last)
            last = min(max((s.offset + s.size for s in covered), default=last), last)
        skip = first - segment.offset
        _check_inside(segment.vaddr + skip, segment.memsz - skip, source)
        if last > first:
            found.append(Piece(segment.paddr + skip, segment.vaddr + skip, first, last - first))
    if not file.segments:
        for section in held:
            _check_inside(section.address, section.size, source)
        found = [Piece(s.address, s.address, s.offset, s.size) for s in filled]
    for piece in found:
        _check_inside(piece.load, piece.size, source)
    found.sort(key=lambda piece: in_flash(piece.load))
    for one, two in pairwise(found):
        if in_flash(one.load) + one.size > in_flash(two.load):
            raise FirmwareError(f"{source}: segments overlap at {two.load:#010x}")
    return found


def _check_inside(address: int, size: int, source: str) -> None:
    if size and not holds(address, size):
        raise FirmwareError(
            f"{source}: segment at {address:#010x} of {size} bytes lies outside the memory of an STM32F405"
        )


def memory(file: Elf, pieces: list[Piece]) -> tuple[bytes, Contents, Contents]:
    """Contents of flash from FLASH on, of RAM, and what the start-up code is to copy."""
    flash = bytearray()
    ram, copied = [], []
    for load, run, offset, size in pieces:
        content = file.data[offset : offset + size]
        at = in_flash(load) - FLASH
        if 0 <= at < FLASH_SIZE:
            flash.extend(b"\xff" * (at - len(flash)))
            flash.extend(content)
        else:
            ram.append((load, content))
        if in_flash(run) != in_flash(load):
            copied.append((run, content))
    return bytes(flash), tuple(ram), tuple(copied)


def addresses(symbols: list[Symbol]) -> dict[str, int]:
    """Addresses by name; of several with one name a global one counts."""
    found = {}
    for symbol in sorted(symbols, key=_rank):
        defined = symbol.section and symbol.kind not in (elf.STT_SECTION, elf.STT_FILE)
        if defined and symbol.name and _mark(symbol) == "":
            found[symbol.name] = symbol.value & ~1 if symbol.kind == elf.STT_FUNC else symbol.value
    return found


def functions(symbols: list[Symbol], code: Spans) -> list[tuple[int, str]]:
    """Functions by address; labels count if they are global. Of aliases the strongest is last."""
    found = []
    for symbol in sorted(symbols, key=_rank):
        label = symbol.kind == elf.STT_NOTYPE and symbol.bind == elf.STB_GLOBAL
        if symbol.section and symbol.name and (symbol.kind == elf.STT_FUNC or label):
            address = symbol.value & ~1
            if symbol.kind == elf.STT_FUNC or inside(code, address):
                found.append((address, symbol.name))
    return sorted(found, key=lambda function: function[0])


def _rank(symbol: Symbol) -> int:
    """Weak before local before global; labels before functions."""
    return (symbol.bind == elf.STB_GLOBAL) * 4 + (symbol.bind == 0) * 2 + (symbol.kind == elf.STT_FUNC)


def _mark(symbol: Symbol) -> str:
    """$t, $d or $a: what follows is Thumb, data, ARM (ELF for the ARM architecture, 4.5.5); '' for others."""
    name = symbol.name
    return name[:2] if name[:2] in ("$t", "$d", "$a") and name[2:3] in ("", ".") else ""


def spans(file: Elf, symbols: list[Symbol]) -> tuple[Spans, Spans]:
    """Ranges of Thumb and of ARM instructions, by the addresses at which they run."""
    marks = sorted((symbol.value & ~1, mark) for symbol in symbols if (mark := _mark(symbol)))
    thumb_at = [address for address, mark in marks if mark == "$t"]

    def holds_code(section: elf.Section) -> bool:
        # An assembler section may lack the flag: that there are instructions the mapping symbols say, too.
        k = bisect_left(thumb_at, section.address)
        marked = k < len(thumb_at) and thumb_at[k] < section.address + section.size
        return marked or bool(section.flags & elf.SHF_EXECINSTR)

    ranges = [
        (s.address + s.address % 2, s.address + s.size)
        for s in file.sections
        if s.flags & elf.SHF_ALLOC and s.kind != elf.SHT_NOBITS and holds_code(s)
    ] or [(s.vaddr + s.vaddr % 2, s.vaddr + s.filesz) for s in file.segments if s.flags & elf.PF_X]
    thumb: list[tuple[int, int]] = []
    arm: list[tuple[int, int]] = []
    for start, end in _disjoint(ranges):
        known = marks[bisect_left(marks, (start, "")) : bisect_left(marks, (end, ""))]
        if not known:
            thumb.append((start, end))
        for (a, mark), (b, _) in pairwise([*known, (end, "")]):
            if b > a and mark != "$d":
                (thumb if mark == "$t" else arm).append((a, b))
    return tuple(thumb), tuple(arm)


def _disjoint(ranges: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """The ranges that lie in memory, in order, without what an earlier one covers."""
    found: list[tuple[int, int]] = []
    for start, end in sorted(ranges):
        first = max(start, found[-1][1] if found else 0)
        if first < end and holds(first, end - first):
            found.append((first, end))
    return found


def flash_code(spans: Spans, end: int) -> Spans:
    """Those of `spans` that lie in flash before `end`, by their address in flash proper."""
    found = _disjoint([(in_flash(a), min(in_flash(a) + b - a, end)) for a, b in spans])
    return tuple((a, b) for a, b in found if FLASH <= a < end)
