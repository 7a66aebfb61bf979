"""Small programs for the emulated MCU, assembled for one test each."""

import re
import subprocess
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from targets.mcu.image import Image, parse
from targets.mcu.machine import Stm32f405

LOG = 0x20000000
"""Where programs note numbers: the count of bytes, then a word each."""

_SYSTEM = (
    *("reset", "nmi", "hard_fault", "mem_manage", "bus_fault", "usage_fault"),
    *("0", "0", "0", "0", "sv_call", "debug_monitor", "0", "pend_sv", "sys_tick"),
)
_HANDLERS = (*_SYSTEM, *(f"irq{k}" for k in range(96)))

_MACROS = """
.syntax unified
.cpu cortex-m4
.fpu fpv4-sp-d16
.thumb
.text
.thumb_func
unexpected: b .

.macro handler name
    .ltorg
    .global \\name
    .thumb_func
    \\name:
.endm

@ A word noted for the test: r0 to r2 are used.
.macro note value
    ldr r2, =\\value
    bl noted
.endm
.thumb_func
noted:
    ldr r0, =log
    ldr r1, [r0]
    adds r1, #4
    str r1, [r0]
    str r2, [r0, r1]
    bx lr
    .ltorg

@ A word stored at an address: r0 and r1 are used.
.macro put address, value
    ldr r0, =\\address
    ldr r1, =\\value
    str r1, [r0]
.endm

.macro fpu_on
    put 0xE000ED88, 0xF00000
    dsb
    isb
.endm
"""
_LINK = """
MEMORY {{ FLASH (rx) : ORIGIN = 0x08000000, LENGTH = 64K }}
ENTRY(reset)
stack_top = 0x2001C000;
log = {log:#x};
SECTIONS {{ .text : {{ *(.vectors) *(.text*) }} > FLASH /DISCARD/ : {{ *(.ARM*) }} }}
"""

FLAGS = ("-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16", "-nostdlib")


def linked(files: dict[str, str], *options: str) -> Image:
    """An image of sources, name -> text, the linker script among them."""
    with TemporaryDirectory() as folder:
        for name, text in files.items():
            (Path(folder) / name).write_text(text)
        script = next(name for name in files if name.endswith(".ld"))
        sources = [name for name in files if not name.endswith((".ld", ".h"))]
        command = ["arm-none-eabi-gcc", *FLAGS, *options, *sources, "-T", script, "-o", "out.elf"]
        subprocess.run(command, cwd=folder, check=True)
        return parse((Path(folder) / "out.elf").read_bytes())


@cache
def _assembled(text: str) -> Image:
    given = set(re.findall(r"handler (\w+)", text)) | {"0"}
    vectors = (name if name in given else "unexpected" for name in _HANDLERS)
    table = "".join(f".word {name}\n" for name in ("stack_top", *vectors))
    source = f'{_MACROS}\n{text}\n.section .vectors, "a"\n{table}'
    return linked({"a.s": source, "link.ld": _LINK.format(log=LOG)})


class Program:
    """A program on an MCU of its own."""

    def __init__(self, image: Image, **options: object) -> None:
        self.mcu = Stm32f405(image, **options)  # type: ignore[arg-type]

    def run(self, until_ns: int = 1_000_000) -> list[int]:
        """Run to `until_ns`; what the program noted."""
        self.mcu.run(until_ns)
        return self.noted()

    def noted(self) -> list[int]:
        """The numbers noted up to now."""
        count = self.mcu.read_word(LOG) // 4
        return [self.mcu.read_word(LOG + 4 + 4 * k) for k in range(count)]


@pytest.fixture
def program(arm_gcc):
    """A function from the text of a program, and the options of its MCU, to a Program.

    Handlers are labels: `handler sys_tick`; those not given are an endless loop. `note N` notes a number.
    """
    return lambda text, **options: Program(_assembled(text), **options)
