"""Source lines: as binutils finds them, in every version of DWARF, and no damaged table does harm."""

import shutil
import subprocess

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from targets.firmware import ELF, HERE
from targets.mcu import dwarf, elf
from targets.mcu.image import load, parse
from targets.mcu.memory_map import FLASH

SPAN = ((FLASH, FLASH + 0x100000),)


def addr2line(path, addresses):
    """`file:line` from binutils, '' where it knows none."""
    if shutil.which("arm-none-eabi-addr2line") is None:
        pytest.skip("no arm-none-eabi-addr2line on this machine")
    command = ["arm-none-eabi-addr2line", "-e", str(path), *map(hex, addresses)]
    lines = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
    lines = [line.split(" (")[0] for line in lines]
    return ["" if line.startswith("?") or line.endswith((":?", ":0")) else line for line in lines]


def test_shipped_image_as_binutils_reads_it():
    """Every halfword of code has the line that addr2line finds."""
    image = load(ELF["ifd"])
    addresses = [address for start, end in image.code for address in range(start, end, 2)]
    theirs = addr2line(ELF["ifd"], addresses)
    ours = [image.line_at(address) for address in addresses]
    assert len(set(ours)) > 100
    # Theirs names the compiler's folder where ours is relative to it.
    different = [(a, b) for a, b in zip(ours, theirs, strict=True) if not b.endswith(a) or bool(a) != bool(b)]
    assert different == []


SOURCE = """#include "deep/sink.h"
int f(int x)
{
\tput(x * x);
\tfor (int k = 0; k < x; k++)
\t\tput(k);

\treturn x;
}
__attribute__((section(".unused"))) int g(void) { return 1; }
"""


@pytest.mark.parametrize("version", [2, 3, 4, 5])
@pytest.mark.parametrize("packed", [False, True], ids=["plain", "compressed"])
def test_versions_of_dwarf(arm_gcc, tmp_path, version, packed):
    """Versions 2 to 5 give the lines that addr2line finds, compressed or not."""
    (tmp_path / "deep").mkdir()
    (tmp_path / "deep" / "sink.h").write_text(
        "volatile int sink;\nstatic inline void put(int x)\n{ sink = x; }\n"
    )
    (tmp_path / "f.c").write_text(SOURCE)
    flags = ["-mcpu=cortex-m4", "-mthumb", "-O1", "-nostdlib", f"-gdwarf-{version}", "-ffunction-sections"]
    link = ["-Wl,-Ttext=0x08000000,-ef,--gc-sections", *(["-gz=zlib"] if packed else [])]
    subprocess.run(["arm-none-eabi-gcc", *flags, *link, "f.c", "-o", "f.elf"], cwd=tmp_path, check=True)
    image = load(tmp_path / "f.elf", vectors=None)
    addresses = range(FLASH, FLASH + len(image.flash), 2)
    ours = [image.line_at(address) for address in addresses]
    assert {"f.c:4", "f.c:5", "deep/sink.h:3"} <= set(ours)
    assert image.line_at(0) == ours[0]  # through the alias
    assert image.lines.at(0) == ""  # where the dropped function's lines would be
    theirs = addr2line(tmp_path / "f.elf", addresses)
    assert [line.removeprefix(f"{tmp_path}/").removeprefix("./") for line in theirs] == ours


def test_image_without_debug_data():
    """Without a line table every address is of an unknown line."""
    from tests.targets.mcu.made import Part
    from tests.targets.mcu.made import elf as made

    image = parse(made(Part(".text", FLASH, bytes(16))), vectors=None)
    assert image.line_at(FLASH) == ""
    assert image.lines.places == []


def test_code_that_start_up_copies_has_lines_where_it_runs(arm_gcc, tmp_path):
    """A function that runs in SRAM has its lines there."""
    (tmp_path / "f.c").write_text('__attribute__((section(".fast"))) int f(int x)\n{\n\treturn x + 3;\n}\n')
    flags = ["-mcpu=cortex-m4", "-mthumb", "-O1", "-nostdlib", "-g"]
    link = "-Wl,-Ttext=0x08000000,--section-start=.fast=0x20000100,-ef"
    subprocess.run(["arm-none-eabi-gcc", *flags, link, "f.c", "-o", "f.elf"], cwd=tmp_path, check=True)
    image = load(tmp_path / "f.elf", vectors=None)
    assert image.line_at(0x20000100) == "f.c:4"
    assert image.function_at(0x20000100) == "f"


def table(program: bytes, **header: int) -> bytes:
    """A .debug_line of one unit of version 3 with one file, `a.c`."""
    fields = {"version": 3, "minimum": 2, "line_base": -5 & 0xFF, "line_range": 14, "opcodes": 13} | header
    lengths = bytes((0, 1, 1, 1, 1, 0, 0, 0, 1, 0, 0, 1))[: fields["opcodes"] - 1]
    after = bytes((fields["minimum"], 1, fields["line_base"], fields["line_range"], fields["opcodes"]))
    after += lengths + b"\0" + b"a.c\0\0\0\0" + b"\0"
    unit = fields["version"].to_bytes(2, "little") + len(after).to_bytes(4, "little") + after + program
    return len(unit).to_bytes(4, "little") + unit


def lines_of(content: bytes) -> dwarf.Lines:
    from tests.targets.mcu.made import Part
    from tests.targets.mcu.made import elf as made

    debug = Part(".debug_line", 0, content, flags=0, segment=False)
    return dwarf.lines(elf.read(made(Part(".text", FLASH, bytes(16)), debug), "made"), SPAN)


AT_FLASH = b"\x00\x05\x02" + FLASH.to_bytes(4, "little")
END = b"\x00\x01\x01"


def test_line_number_program():
    """Addresses advance by instructions of the minimum length; lines may run backwards; line 0 is unknown."""
    program = (
        AT_FLASH + b"\x03\x09\x01" + b"\x02\x02\x03\x7d\x01" + b"\x02\x01\x03\x79\x01" + b"\x02\x03" + END
    )
    found = lines_of(table(program))
    assert [found.at(FLASH + k) for k in range(0, 14, 2)] == ["a.c:10"] * 2 + ["a.c:7"] + [""] * 4


def test_damaged_unit_costs_its_own_lines():
    """A unit that cannot be read is passed over; those behind it are read."""
    good = table(AT_FLASH + b"\x01\x02\x08" + END)
    for bad in (table(b"", version=9), table(AT_FLASH, line_range=0), table(b"\x02" + b"\xff" * 20)):
        assert lines_of(bad + good).at(FLASH) == "a.c:1"
    assert lines_of(good).at(FLASH + 15) == "a.c:1"
    assert lines_of(good).at(FLASH + 16) == ""


@given(st.binary(max_size=60), st.integers(0, 255), st.integers(2, 5))
@settings(max_examples=150)
def test_any_program_ends(program, line_range, version):
    """Whatever a line table holds, reading it ends, without an exception."""
    found = lines_of(table(AT_FLASH + program + END, version=version, line_range=line_range))
    assert isinstance(found.at(FLASH), str)


def test_names_without_end_stay_small():
    """A table that promises more files than it has bytes is not believed."""
    header = (
        (5).to_bytes(2, "little") + b"\x04\x00" + (12).to_bytes(4, "little") + bytes((2, 1, 1, 0xFB, 14, 1))
    )
    unit = header + b"\x00" + b"\xff\xff\xff\xff\x0f" + AT_FLASH
    assert lines_of(len(unit).to_bytes(4, "little") + unit).places == []


def test_sources_of_the_shipped_image_exist():
    """Files are named as they lie below the firmware's folder."""
    names = {place.rpartition(":")[0] for place in load(ELF["ifd"]).lines.places}
    own = {name for name in names if not name.startswith("..")}  # the rest is the compiler's library
    assert own
    assert all((HERE / name).is_file() for name in own)
