"""Flash and RAM of an image, and the stack it used."""

import io

import pytest

from targets.errors import FirmwareError
from targets.firmware import ELF, STEP_ELF
from targets.footprint import deepest_stack, footprint, paint_stack
from targets.mcu.image import load
from targets.mcu.machine import SRAM
from tests.targets.test_oscilloscope import ridden


@pytest.mark.parametrize("path", STEP_ELF.values(), ids=lambda path: path.stem)
def test_sections_are_what_the_linker_says(path):
    """Flash is what the image occupies, RAM ends where the linker's symbol says."""
    found, image = footprint(path), load(path)
    assert found.flash == len(image.flash)
    assert found.ram_end == image.symbol("bss_end")
    assert found.ram == image.symbol("bss_end") - SRAM
    assert {memory for *_, memory in found.sections} == {"flash", "RAM"}


def test_largest_symbols_first():
    """The ECU's state is the largest thing in RAM, and symbols come in order of size."""
    symbols = footprint(ELF["ifd"]).symbols
    assert symbols[0][0] == "state"
    assert [size for *_, size in symbols] == sorted((size for *_, size in symbols), reverse=True)


def test_shipped_code_is_within_its_budget():
    """The shipped IFD takes at most 12 kB of flash with its network, and 6 kB of RAM with its stack."""
    from targets.ecus import build

    found = footprint(ELF["ifd"])
    assert found.flash + len(build().calibration.image()) <= 12 * 1024
    ecu = build().power_on()
    paint_stack(ecu.mcu, found.ram_end)
    ridden(ecu)
    stack = deepest_stack(ecu.mcu, found.ram_end)
    assert stack > 100
    assert found.ram + stack <= 6 * 1024


def test_untouched_stack(mcu_ecu):
    """Before the firmware runs, nothing of the painted stack is used."""
    end = footprint(ELF["ifd"]).ram_end
    paint_stack(mcu_ecu.mcu, end)
    assert deepest_stack(mcu_ecu.mcu, end) == 0


def test_copied_data_counts_twice(tmp_path):
    """Initialised variables take flash and RAM."""
    from elftools.elf.elffile import ELFFile

    data = bytearray(ELF["ifd"].read_bytes())
    elf = ELFFile(io.BytesIO(bytes(data)))
    index = elf.get_section_index(".bss")
    header = elf["e_shoff"] + index * elf["e_shentsize"]
    data[header + 4 : header + 8] = (1).to_bytes(4, "little")  # SHT_PROGBITS
    (tmp_path / "data.elf").write_bytes(data)
    before, after = footprint(ELF["ifd"]), footprint(tmp_path / "data.elf")
    assert after.ram == before.ram
    assert after.flash == before.flash + before.ram


def test_what_is_no_image(tmp_path):
    """A file that is absent or no ELF is refused by name."""
    (tmp_path / "text.elf").write_text("no image at all, but long enough to hold a header of one")
    with pytest.raises(FirmwareError, match=r"text.elf: not an ELF file"):
        footprint(tmp_path / "text.elf")
    with pytest.raises(FirmwareError, match=r"none.elf: no such file"):
        footprint(tmp_path / "none.elf")
