"""Small programs in machine code, as images."""

import struct

from targets.mcu.image import FLASH, Image

ENTRY = 0x200
"""Offset of the program: behind a vector table with all interrupts."""


def program(words: str, handlers: dict[int, str] | None = None) -> Image:
    """An image of machine code: lines of half-words as a disassembler prints them, in hexadecimal, and after
    three blanks what they mean.

    handlers: interrupt number -> machine code.
    """
    code = bytearray(_halfwords(words))
    vectors = [0x20020000, FLASH + ENTRY + 1, *[0] * 96]
    for irq, handler in (handlers or {}).items():
        code += b"\x00\xbf" * (len(code) // 2 % 2)  # nop: literals lie on words
        vectors[16 + irq] = FLASH + ENTRY + len(code) + 1
        code += _halfwords(handler)
    table = struct.pack(f"<{len(vectors)}I", *vectors).ljust(ENTRY, b"\0")
    flash = table + bytes(code)
    return Image(flash, ((FLASH + ENTRY, FLASH + len(flash)),), {}, (), "", "program")


def _halfwords(words: str) -> bytes:
    codes = [line.strip().split("   ")[0] for line in words.splitlines()]
    return b"".join(struct.pack("<H", int(word, 16)) for code in codes for word in code.split())
