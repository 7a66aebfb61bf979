"""What of an ELF file goes where, and what may not go there."""

import pytest

from targets.errors import FirmwareError
from targets.firmware import ELF
from targets.mcu.image import parse
from targets.mcu.memory_map import CCM, FLASH, SRAM
from tests.targets.mcu.made import ALLOC, NOBITS, NOTYPE, OBJECT, WRITE, Part, Symbol, elf

DATA = ALLOC | WRITE
CODE = Part(".text", FLASH, bytes(range(16)))


def bare(*parts, **rest):
    return parse(elf(*parts, **rest), vectors=None)


def test_flash_is_filled_up_to_the_last_byte():
    """Contents lie at their load addresses; what is between them is erased flash."""
    loaded = bare(CODE, Part(".rodata", FLASH + 0x20, b"read", flags=ALLOC))
    assert loaded.flash == bytes(range(16)) + b"\xff" * 16 + b"read"
    assert (loaded.ram, loaded.copied) == ((), ())


def test_initial_data_is_in_flash_and_copied():
    """Data that start-up code copies is put into flash, and its run address is known."""
    loaded = bare(CODE, Part(".data", SRAM, b"init", load=FLASH + 16, flags=DATA))
    assert loaded.flash[16:] == b"init"
    assert loaded.copied == ((SRAM, b"init"),)
    assert loaded.ram == ()


@pytest.mark.parametrize("at", [SRAM, SRAM + 0x1FFF0, CCM], ids=["sram1", "sram2-end", "ccm"])
def test_data_at_its_link_address(at):
    """Bytes that are loaded where they run go to RAM as a debugger would put them."""
    loaded = bare(CODE, Part(".data", at, b"0123456789abcdef", flags=DATA))
    assert loaded.ram == ((at, b"0123456789abcdef"),)
    assert loaded.word(at + 4) == int.from_bytes(b"4567", "little")


def test_alias_of_flash():
    """An image linked to address 0 is put into flash, which the boot pins make appear there."""
    loaded = bare(Part(".text", 0x100, b"code"), symbols=(Symbol("run", 0x101),))
    assert loaded.flash == b"\xff" * 0x100 + b"code"
    assert loaded.code == ((FLASH + 0x100, FLASH + 0x104),)
    assert loaded.function_at(0x102) == "run"
    assert loaded.word(0x100) == loaded.word(FLASH + 0x100)


@pytest.mark.parametrize(
    ("part", "named"),
    [
        (Part(".text", 0x00100000, b"code"), "0x00100000 of 4"),
        (Part(".text", FLASH + 0xFFFFE, b"code"), "0x080ffffe of 4"),
        (Part(".text", FLASH - 2, b"code"), "0x07fffffe of 4"),
        (Part(".data", SRAM + 0x1FFFE, b"data"), "0x2001fffe of 4"),
        (Part(".data", CCM + 0x10000, b"data"), "0x10010000 of 4"),
        (Part(".data", 0x64000000, b"data"), "0x64000000 of 4"),
        (Part(".data", SRAM, b"data", load=0xC0000000), "0xc0000000 of 4"),
        (Part(".bss", SRAM, kind=NOBITS, room=0xFFFFFFFF), "0x20000000 of 4294967295"),
        (Part(".bss", 0xFFFFFFF0, kind=NOBITS, room=32), "0xfffffff0 of 32"),
        (Part(".data", SRAM, b"data", room=0x20001), "0x20000000 of 131073"),
    ],
    ids=[
        *("alias-end", "flash-end", "flash-start", "sram-end", "ccm-end", "external", "load-address"),
        *("four-gigabytes", "address-overflow", "bss-too-large"),
    ],
)
def test_outside_memory(part, named):
    """What this MCU has no memory for is refused with its address and size."""
    with pytest.raises(FirmwareError, match=f"segment at {named} bytes lies outside"):
        bare(part)
    if part.load is None:
        with pytest.raises(FirmwareError, match=f"segment at {named} bytes lies outside"):
            bare(Part(part.name, part.run, part.content, room=part.room, kind=part.kind), with_sections=False)


@pytest.mark.parametrize(
    ("one", "two"),
    [(FLASH, FLASH + 15), (FLASH, 8), (0, FLASH + 8), (SRAM, SRAM + 4)],
    ids=["flash", "alias-second", "alias-first", "sram"],
)
def test_overlap(one, two):
    """Two contents for one address are refused, through the alias of flash, too."""
    with pytest.raises(FirmwareError, match="segments overlap at 0x"):
        bare(Part(".a", one, bytes(16)), Part(".b", two, bytes(16)))


def test_overlays_may_share_their_run_address():
    """Contents that are copied to one address in turn do not overlap."""
    overlays = [Part(f".o{k}", SRAM, bytes(4), load=FLASH + 16 + 4 * k) for k in range(2)]
    assert len(bare(CODE, *overlays).copied) == 2


def test_headers_within_the_first_segment():
    """A segment that a linker extended over the file's headers loads without them, below flash or not."""
    loaded = bare(CODE, symbols=(Symbol("run", FLASH + 1),), headers_in_first=True)
    assert loaded.flash == bytes(range(16))


def test_sections_serve_without_segments():
    """Without program headers the allocated sections say what is loaded."""
    loaded = bare(
        Part(".text", FLASH, b"code", segment=False),
        Part(".data", SRAM, b"data", flags=DATA, segment=False),
        Part(".comment", 0, b"words", flags=0, segment=False),
        Part(".bss", SRAM + 4, flags=DATA, kind=NOBITS, room=16, segment=False),
    )
    assert (loaded.flash, loaded.ram) == (b"code", ((SRAM, b"data"),))


def test_segments_serve_without_sections():
    """Without section headers the segments are loaded whole."""
    loaded = parse(elf(CODE, with_sections=False), vectors=None)
    assert loaded.flash == bytes(range(16))
    assert loaded.code == ((FLASH, FLASH + 16),)


def test_code_spans_follow_the_mapping_symbols():
    """$t, $d and $a tell Thumb instructions from data and from ARM ones, in flash and in SRAM."""
    marks = (
        *(Symbol("$t", FLASH, NOTYPE), Symbol("$d.1", FLASH + 4, NOTYPE), Symbol("$a", FLASH + 8, NOTYPE)),
        *(Symbol("$t.2", FLASH + 12, NOTYPE), Symbol("$t", SRAM, NOTYPE), Symbol("$d", SRAM + 2, NOTYPE)),
        Symbol("fast", SRAM + 1),
    )
    loaded = bare(CODE, Part(".fast", SRAM, bytes(8), flags=DATA), symbols=marks)
    assert loaded.code == ((FLASH, FLASH + 4), (FLASH + 12, FLASH + 16))
    assert loaded.arm_code == ((FLASH + 8, FLASH + 12),)
    assert loaded.ram_code == ((SRAM, SRAM + 2),)
    assert (loaded.function_at(SRAM), loaded.function_at(SRAM + 2)) == ("fast", "")
    assert "$t" not in loaded.symbols


def test_addresses_of_symbols():
    """Functions lose their Thumb bit, data keeps its address, a global symbol hides a local namesake."""
    symbols = (
        Symbol("same", FLASH + 5, bind=0),
        Symbol("same", FLASH + 9),
        Symbol("data", SRAM + 3, OBJECT),
        Symbol("absent", 0, NOTYPE, section=0),
    )
    loaded = bare(CODE, symbols=symbols)
    assert loaded.symbols == {"same": FLASH + 8, "data": SRAM + 3}


def test_function_at():
    """Of several names for one address the strongest counts; global labels of assembler are functions."""
    weak = 2
    symbols = (
        *(Symbol("default_handler", FLASH + 1), Symbol("usart_handler", FLASH + 1, bind=weak)),
        *(Symbol("kernel", FLASH + 8, NOTYPE), Symbol("loop", FLASH + 10, NOTYPE, bind=0)),
    )
    loaded = bare(CODE, symbols=symbols)
    found = [loaded.function_at(FLASH + at) for at in (0, 6, 8, 14)]
    assert found == ["default_handler", "default_handler", "kernel", "kernel"]
    assert loaded.function_at(8) == "kernel"  # through the alias
    assert loaded.function_at(FLASH + 16) == ""


def test_symbols_as_the_library_reads_them():
    """The shipped image's symbols are those that pyelftools finds."""
    from elftools.elf.elffile import ELFFile

    with ELF["ifd"].open("rb") as file:
        table = ELFFile(file).get_section_by_name(".symtab")
        theirs = {s.name: s["st_value"] for s in table.iter_symbols() if s["st_info"]["type"] == "STT_FUNC"}
    ours = parse(ELF["ifd"].read_bytes()).symbols
    assert theirs
    assert {name: ours[name] for name in theirs} == {name: at & ~1 for name, at in theirs.items()}
