"""Firmware images: an ELF for a Cortex-M4, its bytes where they lie in memory, its symbols and lines."""

from bisect import bisect_right
from dataclasses import dataclass, field
from functools import cached_property
from hashlib import sha256
from pathlib import Path

from targets.errors import FirmwareError
from targets.mcu import attributes, dwarf, elf, loading
from targets.mcu.loading import Contents, Spans
from targets.mcu.memory_map import FLASH, FLASH_SIZE, ends_in_ram, in_flash

VECTORS_ALIGNMENT = 512
"""Of a table with the STM32F405's 98 entries (ARMv7-M B1.5.3)."""


@dataclass(frozen=True)
class Image:
    """What a flash tool would write or a debugger load, and what a debugger would know.

    flash: bytes from FLASH on, up to the last one used. ram: further bytes (address, content) for RAM.
    copied: bytes of flash that start-up code copies to these addresses. code, ram_code: [start, end) ranges
    of Thumb instructions in flash (by its address from FLASH on) and in RAM. arm_code: ranges of ARM
    instructions, which no Cortex-M runs. symbols: name -> address (of functions without the Thumb bit).
    functions: (address, name), in order. vectors: where the vector table lies, None if none was asked for.
    file: the ELF itself. Raises nothing but from `symbol`; `load` and `parse` do the checking.
    """

    flash: bytes
    code: Spans
    symbols: dict[str, int]
    functions: tuple[tuple[int, str], ...]
    digest: str
    source: str = ""
    ram: Contents = ()
    copied: Contents = ()
    ram_code: Spans = ()
    arm_code: Spans = ()
    vectors: int | None = FLASH
    file: bytes = field(default=b"", repr=False)

    def symbol(self, name: str) -> int:
        """Address of `name`; FirmwareError if the image has no such symbol."""
        if name not in self.symbols:
            raise FirmwareError(
                f"{self.source}: " + (f"no symbol {name}" if self.symbols else "has no symbols")
            )
        return self.symbols[name]

    def function_at(self, address: int) -> str:
        """The function that holds `address`, '' if it is unknown."""
        if not (0 <= in_flash(address) - FLASH < len(self.flash) or dwarf.inside(self.ram_code, address)):
            return ""
        return self._function_before(address) or self._function_before(in_flash(address))

    def _function_before(self, address: int) -> str:
        k = bisect_right(self.functions, address, key=lambda function: function[0]) - 1
        return self.functions[k][1] if k >= 0 else ""

    def word(self, address: int) -> int | None:
        """The 32-bit word loaded at `address`, None where nothing is."""
        content = self.loaded(address, 4)
        return int.from_bytes(content, "little") if len(content) == 4 else None

    def loaded(self, address: int, most: int = 1) -> bytes:
        """Up to `most` bytes of what is loaded from `address` on, empty where nothing is."""
        for base, content in ((FLASH, self.flash), *self.ram):
            at = in_flash(address) - base
            if 0 <= at < len(content):
                return content[at : at + most]
        return b""

    @cached_property
    def lines(self) -> dwarf.Lines:
        """Source lines of all code, from DWARF; empty if the file has none."""
        if not self.file:
            return dwarf.Lines([], [], [])
        file = elf.read(self.file, self.source)
        return dwarf.lines(file, loading.spans(file, elf.symbols(file, self.source))[0])

    def line_at(self, address: int) -> str:
        """`file:line` of the instruction at `address`, '' if it is unknown."""
        return self.lines.at(address) or self.lines.at(in_flash(address))


def load(path: Path, vectors: int | None = FLASH) -> Image:
    """Read an ELF file; FirmwareError for anything that this MCU could not run.

    vectors: where its vector table is to lie; None for a file that needs none.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise FirmwareError(f"{path}: {(error.strerror or str(error)).lower()}") from None
    return parse(data, str(path), vectors)


def parse(data: bytes, source: str = "firmware", vectors: int | None = FLASH) -> Image:
    """An image from the bytes of an ELF file."""
    file = elf.read(data, source)
    attributes.check_core(attributes.read(file), source)
    flash, ram, copied = loading.memory(file, loading.pieces(file, source))
    symbols = elf.symbols(file, source)
    thumb, arm = loading.spans(file, symbols)
    image = Image(
        flash,
        loading.flash_code(thumb, FLASH + len(flash)),
        loading.addresses(symbols),
        tuple(loading.functions(symbols, thumb)),
        sha256(data).hexdigest(),
        source,
        ram,
        copied,
        tuple(span for span in thumb if in_flash(span[0]) >= FLASH + FLASH_SIZE),
        arm,
        vectors,
        data,
    )
    if vectors is not None:
        _check_vectors(image, vectors)
    return image


def _check_vectors(image: Image, at: int) -> None:
    """Refuse an image that does not begin, at `at`, with a stack pointer and a reset vector."""
    source = image.source
    if at % VECTORS_ALIGNMENT:
        raise FirmwareError(f"{source}: vector table at {at:#x}: not a multiple of {VECTORS_ALIGNMENT} bytes")
    stack, entry = image.word(at), image.word(at + 4)
    if stack is None or entry is None:
        raise FirmwareError(f"{source}: no vector table at {at:#010x}{_hint(image)}")
    if not _is_vectors(image, at):
        raise FirmwareError(
            f"{source}: no vector table at {at:#010x} (stack {stack:#x}, reset {entry:#x}){_hint(image)}"
        )


def _is_vectors(image: Image, at: int) -> bool:
    stack, entry = image.word(at) or 0, image.word(at + 4) or 0
    return ends_in_ram(stack) and stack % 4 == 0 and entry % 2 == 1 and image.loaded(entry & ~1) != b""


def _hint(image: Image) -> str:
    """Where a vector table seems to be instead: at the first byte loaded that is none of erased flash."""
    first = len(image.flash) - len(image.flash.lstrip(b"\xff"))
    for at in (FLASH + first, *(address for address, _ in image.ram)):
        if at % VECTORS_ALIGNMENT == 0 and _is_vectors(image, at):
            return f"; there is one at {at:#010x} (--vectors {at:#x})"
    return ""
