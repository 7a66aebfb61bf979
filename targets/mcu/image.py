"""Firmware images: an ELF for a Cortex-M4, its bytes where they lie in flash, its symbols."""

import io
from bisect import bisect_right
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from targets.errors import FirmwareError

FLASH = 0x08000000
FLASH_SIZE = 0x100000


@dataclass(frozen=True)
class Image:
    """What a flash tool would write, and what a debugger would know.

    flash: bytes from FLASH on, up to the last one used. code: [start, end) ranges that hold instructions.
    symbols: name -> address (bit 0 cleared). Raises nothing itself; `load` and `parse` do the checking.
    """

    flash: bytes
    code: tuple[tuple[int, int], ...]
    symbols: dict[str, int]
    functions: tuple[tuple[int, str], ...]
    digest: str
    source: str = ""

    def symbol(self, name: str) -> int:
        """Address of `name`; FirmwareError if the image has no such symbol."""
        if name not in self.symbols:
            raise FirmwareError(f"{self.source}: no symbol {name}")
        return self.symbols[name]

    def function_at(self, address: int) -> str:
        """The function that holds `address`, '' if it is unknown."""
        k = bisect_right(self.functions, (address, "\uffff")) - 1
        inside = FLASH <= address < FLASH + len(self.flash)
        return self.functions[k][1] if k >= 0 and inside else ""

    def line_at(self, address: int) -> str:
        """`file:line` of the instruction at `address`, '' if it is unknown."""
        return ""


def load(path: Path) -> Image:
    """Read an ELF file; FirmwareError for anything that this MCU could not run."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise FirmwareError(f"{path}: {(error.strerror or str(error)).lower()}") from None
    return parse(data, str(path))


def parse(data: bytes, source: str = "firmware") -> Image:
    """An image from the bytes of an ELF file."""
    from elftools.common.exceptions import ELFError, ELFParseError

    if not data.startswith(b"\x7fELF"):
        raise FirmwareError(f"{source}: not an ELF file")
    try:
        return _parse(data, source)
    except (ELFError, ELFParseError, ValueError, KeyError, IndexError, AttributeError, TypeError) as error:
        raise FirmwareError(f"{source}: damaged ELF file ({error})") from None


def _parse(data: bytes, source: str) -> Image:
    from hashlib import sha256

    from elftools.elf.elffile import ELFFile
    from elftools.elf.sections import SymbolTableSection

    elf = ELFFile(io.BytesIO(data))
    if elf["e_machine"] != "EM_ARM" or elf.elfclass != 32 or not elf.little_endian:
        raise FirmwareError(
            f"{source}: built for {elf.get_machine_arch()}, not for a little-endian ARM Cortex-M4"
        )
    flash = bytearray()
    for segment in elf.iter_segments("PT_LOAD"):
        start, content = segment["p_paddr"], segment.data()
        if len(content) < segment["p_filesz"]:
            raise FirmwareError(f"{source}: truncated at segment {start:#010x}")
        if not content:
            continue
        at = start - FLASH
        if at < 0 or at + len(content) > FLASH_SIZE:
            raise FirmwareError(f"{source}: segment at {start:#010x} lies outside flash")
        flash.extend(b"\xff" * (at + len(content) - len(flash)))
        flash[at : at + len(content)] = content
    if len(flash) < 8:
        raise FirmwareError(f"{source}: no vector table at {FLASH:#010x}")
    stack, entry = (int.from_bytes(flash[k : k + 4], "little") for k in (0, 4))
    if not 0x10000000 < stack <= 0x20020000 or not entry & 1 or not FLASH <= entry < FLASH + len(flash):
        raise FirmwareError(
            f"{source}: no vector table at {FLASH:#010x} (stack {stack:#x}, reset {entry:#x})"
        )

    symbols, functions, marks = {}, [], []
    for section in elf.iter_sections():
        if not isinstance(section, SymbolTableSection):
            continue
        for symbol in section.iter_symbols():
            name, value = symbol.name, symbol["st_value"]
            if name.startswith(("$t", "$d", "$a")):
                if FLASH <= value < FLASH + len(flash):
                    marks.append((value, name[:2] == "$t"))
            elif name and symbol["st_info"]["type"] != "STT_FILE":
                symbols[name] = value & ~1 if symbol["st_info"]["type"] == "STT_FUNC" else value
                if symbol["st_info"]["type"] == "STT_FUNC":
                    functions.append((value & ~1, name))
    return Image(
        bytes(flash),
        tuple(_spans(sorted(marks), FLASH + len(flash))),
        symbols,
        tuple(sorted(functions)),
        sha256(data).hexdigest(),
        source,
    )


def _spans(marks: list[tuple[int, bool]], end: int) -> list[tuple[int, int]]:
    """Ranges of instructions from the mapping symbols $t and $d (ELF for the ARM architecture, 4.5.5)."""
    if not marks:
        return [(FLASH, end)]
    edges = [*marks, (end, False)]
    return [(a, b) for (a, thumb), (b, _) in pairwise(edges) if thumb and b > a]
