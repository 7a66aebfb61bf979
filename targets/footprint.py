"""The flash and the RAM that an image takes: sections and symbols of the ELF, and the stack as it was used.

Belongs here: bytes. Never: whether they are many.
"""

import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from targets.errors import FirmwareError
from targets.mcu.machine import SRAM, Stm32f405

_ALLOCATED, _WRITABLE = 2, 1  # SHF_ALLOC, SHF_WRITE
_PAINT = 0xA5


@dataclass(frozen=True)
class Footprint:
    """Bytes an image takes: of flash, of RAM before any stack.

    sections: (name, address, bytes, memory), memory "flash", "RAM" or both for data that start-up copies.
    symbols: (name, address, bytes), the largest first. ram_end: where the last variable ends.
    """

    flash: int
    ram: int
    ram_end: int
    sections: tuple[tuple[str, int, int, str], ...]
    symbols: tuple[tuple[str, int, int], ...]


def footprint(path: Path) -> Footprint:
    """What the ELF at `path` takes; FirmwareError if it is none."""
    from elftools.common.exceptions import ELFError
    from elftools.elf.elffile import ELFFile

    try:
        elf = ELFFile(io.BytesIO(path.read_bytes()))
        sections = [s for s in elf.iter_sections() if s["sh_flags"] & _ALLOCATED and s["sh_size"]]
        table = elf.get_section_by_name(".symtab")
        symbols = [(s.name, s["st_value"] & ~1, s["st_size"]) for s in table.iter_symbols()] if table else []
    except OSError as error:
        raise FirmwareError(f"{path}: {(error.strerror or str(error)).lower()}") from None
    except ELFError as error:
        raise FirmwareError(f"{path}: not an ELF file ({error})") from None
    rows = []
    for section in sections:
        stored, written = section["sh_type"] != "SHT_NOBITS", bool(section["sh_flags"] & _WRITABLE)
        memory = "flash and RAM" if stored and written else "RAM" if written else "flash"
        rows.append((section.name, section["sh_addr"], section["sh_size"], memory))
    variables = [(address, size) for _, address, size, memory in rows if "RAM" in memory]
    return Footprint(
        sum(size for _, _, size, memory in rows if "flash" in memory),
        sum(size for _, size in variables),
        max((address + size for address, size in variables), default=SRAM),
        tuple(rows),
        tuple(sorted((s for s in symbols if s[0] and s[2]), key=lambda s: -s[2])),
    )


def paint_stack(mcu: Stm32f405, ram_end: int) -> None:
    """Fill the RAM between the last variable and the initial stack pointer, before the firmware runs."""
    low, high = ram_end - SRAM, _initial_stack(mcu) - SRAM
    mcu._sram[low:high] = _PAINT


def deepest_stack(mcu: Stm32f405, ram_end: int) -> int:
    """Bytes of stack used at most since it was painted."""
    low, high = ram_end - SRAM, _initial_stack(mcu) - SRAM
    touched = np.flatnonzero(mcu._sram[low:high] != _PAINT)
    return high - low - int(touched[0]) if len(touched) else 0


def _initial_stack(mcu: Stm32f405) -> int:
    return int.from_bytes(mcu.image.flash[:4], "little")
