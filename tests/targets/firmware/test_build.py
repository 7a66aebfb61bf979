"""The shipped images: built from the sources beside them, one for each role, calibration data apart."""

import io
import shutil
import subprocess

import pytest

from targets.errors import FirmwareError
from targets.firmware import ELF, HERE, STEP_ELF, build
from targets.firmware.variants import LADDER, STEPS
from targets.mcu.image import FLASH, load

CALIBRATION, SECTOR = 0x0800C000, 16 * 1024


@pytest.fixture
def same_gcc(arm_gcc):
    """Skips with another release of the compiler than the shipped images': other bytes are no defect then."""
    done = subprocess.run([build.COMPILER, "--version"], capture_output=True, text=True, check=True)
    here = done.stdout.splitlines()[0].partition(" ")[2]
    if here.encode() not in ELF["ifd"].read_bytes():
        pytest.skip(f"{build.COMPILER} is {here}, not the one the shipped images were made with")


@pytest.mark.parametrize("role", ELF)
def test_shipped_images_are_what_the_sources_make(same_gcc, tmp_path, role):
    """Building a role gives the shipped image, byte for byte."""
    build.build(role, tmp_path / "image.elf")
    assert (tmp_path / "image.elf").read_bytes() == ELF[role].read_bytes()


@pytest.mark.parametrize("code", ["initial", "compiler"])
def test_shipped_steps_are_what_the_sources_make(same_gcc, tmp_path, code):
    """Building the code of a step of the procedure gives its shipped image, byte for byte."""
    build.build("ifd", tmp_path / "image.elf", STEPS[code])
    assert (tmp_path / "image.elf").read_bytes() == STEP_ELF[code].read_bytes()


def test_every_practice_compiles(arm_gcc, tmp_path):
    """The code with every practice that is a macro compiles without a warning, and is another one."""
    build.build("ifd", tmp_path / "down.elf", LADDER["down"])
    build.build("ifd", tmp_path / "fpu.elf", LADDER["fpu"])
    assert load(tmp_path / "down.elf").flash != load(tmp_path / "fpu.elf").flash


def test_library_is_compiled_alike_in_every_step(same_gcc):
    """The exponential is the same code in steps 2 and 3: a library does not follow the program's options."""
    codes = []
    for code in ("initial", "compiler"):
        image = load(STEP_ELF[code])
        start = image.symbol("exponential")
        end = min(address for address, _ in image.functions if address > start)
        codes.append(end - start)
    assert codes[0] == codes[1] > 100


def test_where_it_is_built_does_not_matter(same_gcc, tmp_path, monkeypatch):
    """The same sources in another folder give the same bytes: no path of the machine is in them."""
    shutil.copytree(HERE, tmp_path / "elsewhere")
    monkeypatch.setattr(build, "HERE", tmp_path / "elsewhere")
    build.build("ifd", tmp_path / "image.elf")
    assert (tmp_path / "image.elf").read_bytes() == ELF["ifd"].read_bytes()
    assert str(HERE).encode() not in ELF["ifd"].read_bytes()


def test_no_compiler(tmp_path, monkeypatch):
    """Without the compiler the command that brings it is named, and nothing is written."""
    monkeypatch.setattr(build.shutil, "which", lambda name: None)
    with pytest.raises(FirmwareError, match="apt-get install gcc-arm-none-eabi"):
        build.build("ifd", tmp_path / "image.elf")
    assert list(tmp_path.iterdir()) == []


def test_sources_that_do_not_compile(arm_gcc, tmp_path, monkeypatch):
    """What the compiler says first is the error, and nothing is written."""
    shutil.copytree(HERE, tmp_path / "broken")
    (tmp_path / "broken" / "core" / "ifd.c").write_text("#error no detector\n")
    monkeypatch.setattr(build, "HERE", tmp_path / "broken")
    with pytest.raises(FirmwareError, match="no detector") as caught:
        build.build("ifd", tmp_path / "image.elf")
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "image.elf").exists()


def test_roles_differ_in_the_role_alone():
    """Both images hold the same program at the same addresses; one byte says which ECU it is."""
    ifd, soft = (load(ELF[role]) for role in ("ifd", "soft_sensor"))
    assert ifd.symbols == soft.symbols
    differs = [k for k, (a, b) in enumerate(zip(ifd.flash, soft.flash, strict=True)) if a != b]
    assert [(ifd.flash[k], soft.flash[k]) for k in differs] == [(0, 1)]
    assert ifd.function_at(FLASH + differs[0]) == "main"


@pytest.mark.parametrize("role", ELF)
def test_calibration_has_a_section_of_its_own(role):
    """The calibration's sector is named by symbols, is a whole one, and holds nothing of the program."""
    image = load(ELF[role])
    assert image.symbol("calibration_image") == CALIBRATION
    assert image.symbol("calibration_room") == SECTOR
    assert FLASH + len(image.flash) <= CALIBRATION


@pytest.mark.parametrize("role", ELF)
def test_program_needs_no_library_and_no_data(role):
    """Every symbol is defined, nothing is dynamic, and no variable but those zeroed at start is in SRAM."""
    from elftools.elf.elffile import ELFFile

    elf = ELFFile(io.BytesIO(ELF[role].read_bytes()))
    undefined = [
        s.name for s in elf.get_section_by_name(".symtab").iter_symbols() if s["st_shndx"] == "SHN_UNDEF"
    ]
    assert undefined == [""]
    assert elf.get_section_by_name(".dynamic") is None
    symbols = load(ELF[role]).symbols
    assert symbols["data_start"] == symbols["data_end"]
    assert symbols["bss_end"] - symbols["bss_start"] < 5 * 1024
