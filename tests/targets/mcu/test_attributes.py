"""For which core a file was built: what a Cortex-M4F runs, and what is refused by name."""

import subprocess

import pytest
from hypothesis import given
from hypothesis import strategies as st

from targets.errors import FirmwareError
from targets.mcu import attributes
from targets.mcu.elf import read
from targets.mcu.image import parse
from targets.mcu.memory_map import FLASH
from tests.targets.mcu.made import Part, elf

CODE = Part(".text", FLASH, bytes(16))
V6T2, V7, V6M, V7EM, V8M = 8, 10, 11, 13, 17
A, M = ord("A"), ord("M")


def bare(tags):
    from tests.targets.mcu.made import attributes as section

    return parse(elf(CODE, section(tags)), vectors=None)


@pytest.mark.parametrize(
    "tags",
    [
        {},
        {5: "Cortex-M4", 6: V7EM, 7: M, 9: 2, 10: 6, 27: 1},
        {5: "Cortex-M3", 6: V7, 7: M},
        {5: "Cortex-M0", 6: V6M, 7: M},
        {5: "Cortex-M7", 6: V7EM, 7: M},
        {6: V6T2, 9: 2},
        {6: V7, 9: 2},
    ],
    ids=["none", "m4f", "m3", "m0", "m7-without-fpu", "assembler-told-no-core", "armv7-common"],
)
def test_cores_whose_code_runs(tags):
    """Code for a Cortex-M4 and for cores whose instructions it has is taken."""
    assert bare(tags).flash == CODE.content


@pytest.mark.parametrize(
    ("tags", "named"),
    [
        ({5: "Cortex-A8", 6: V7, 7: A, 8: 1, 9: 2}, r"Cortex-A8 \(ARMv7\)"),
        ({5: "Cortex-A9", 6: V7, 7: A, 9: 2}, r"Cortex-A9 \(ARMv7\)"),
        ({5: "Cortex-R4", 6: V7, 7: ord("R")}, r"Cortex-R4 \(ARMv7\)"),
        ({5: "Cortex-M33", 6: V8M, 7: M}, r"Cortex-M33 \(ARMv8-M.mainline\)"),
        ({5: "ARM7TDMI", 6: 2, 8: 1, 9: 1}, r"ARM7TDMI \(ARMv4T\)"),
        ({6: 2, 8: 1}, "ARMv4T"),
        ({6: 21, 7: M}, "ARMv8.1-M.mainline"),
        ({6: 99}, "architecture 99"),
        ({5: "Cortex-M7", 6: V7EM, 7: M, 10: 8}, r"the FPv5 unit of Cortex-M7 \(ARMv7E-M\)"),
    ],
    ids=["a8", "a9-thumb", "r4", "m33", "arm7", "arm-state", "m55", "unknown", "m7-fpu"],
)
def test_other_cores_are_refused(tags, named):
    """Code for another core is refused with its name and architecture."""
    with pytest.raises(FirmwareError, match=f"built for {named}"):
        bare(tags)


@given(st.binary(max_size=80))
def test_any_attributes_end(content):
    """Damaged attributes are read as far as they go."""
    part = Part(".ARM.attributes", 0, content, flags=0, kind=0x70000003, segment=False)
    assert isinstance(attributes.read(read(elf(CODE, part), "made")), dict)


@pytest.mark.parametrize(
    ("flags", "complaint"),
    [
        (("-mcpu=cortex-m4", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard"), None),
        (("-mcpu=cortex-m3",), None),
        (("-mcpu=cortex-m7", "-mfpu=fpv5-d16", "-mfloat-abi=hard"), "FPv5"),
        (("-mcpu=cortex-m33",), "ARMv8-M.mainline"),
        (("-mcpu=cortex-a9", "-marm"), r"7-A \(ARMv7\)"),
    ],
    ids=["m4f", "m3", "m7", "m33", "a9"],
)
def test_what_the_compiler_writes(arm_gcc, tmp_path, flags, complaint):
    """Files that gcc linked for a core are told apart."""
    (tmp_path / "f.c").write_text("int f(int x) { return x * x; }\n")
    command = ["arm-none-eabi-gcc", "-mthumb", *flags, "-nostdlib", "-Wl,-Ttext=0x08000000,-ef", "f.c"]
    subprocess.run([*command, "-o", "f.elf"], cwd=tmp_path, check=True)
    data = (tmp_path / "f.elf").read_bytes()
    if complaint is None:
        assert parse(data, vectors=None).symbol("f") == FLASH
        return
    with pytest.raises(FirmwareError, match=complaint):
        parse(data, vectors=None)
