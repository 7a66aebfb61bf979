"""Firmware images: what is taken, what is refused by name."""

import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from targets.errors import FirmwareError
from targets.firmware import ELF
from targets.mcu import image
from tests.targets.mcu.made import NOBITS, Part, Symbol, elf, vectors

LOOP = bytes.fromhex("fee7")  # b .
SHIPPED = ELF["ifd"].read_bytes()


def firmware(at: int = 0x08000000, **rest) -> bytes:
    """A vector table and an endless loop at `at`."""
    return elf(Part(".text", at, vectors(reset=at + 9) + LOOP), **rest)


def patched(elf: bytes, offset: int, new: bytes) -> bytes:
    return elf[:offset] + new + elf[offset + len(new) :]


def test_shipped_image_has_vectors_code_and_symbols():
    """The image starts with the vector table and knows its calibration section."""
    loaded = image.parse(SHIPPED)
    stack, reset = struct.unpack_from("<II", loaded.flash)
    assert stack == 0x2001C000
    assert loaded.function_at(reset & ~1) == "reset_handler"
    assert loaded.symbol("calibration_image") == 0x0800C000


def test_code_spans_leave_out_literal_pools():
    """Ranges of instructions are disjoint, ordered, and less than the whole."""
    loaded = image.parse(SHIPPED)
    assert all(a < b for a, b in loaded.code)
    assert all(b <= c for (_, b), (c, _) in zip(loaded.code, loaded.code[1:], strict=False))
    assert 0 < sum(b - a for a, b in loaded.code) < len(loaded.flash)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (lambda e: b"", "not an ELF"),
        (lambda e: b"MZ" + e[2:], "not an ELF"),
        (lambda e: e[:40], "truncated within its header"),
        (lambda e: e[:60], "truncated: its program headers"),
        (lambda e: e[:3000], "truncated within the segment at 0x08000000"),
        (lambda e: e[:-1], "truncated: its section headers"),
        (lambda e: patched(e, 18, b"\x3e\x00"), "built for 32-bit little-endian x86-64, not for"),
        (lambda e: patched(e, 4, b"\x02"), "built for 64-bit little-endian ARM"),
        (lambda e: patched(e, 5, b"\x02"), "built for 32-bit big-endian"),
        (lambda e: patched(e, 16, b"\x01\x00"), "not linked: a relocatable object"),
        (lambda e: patched(e, 16, b"\x03\x00"), "not linked to addresses: a shared object"),
        (lambda e: patched(e, 16, b"\x04\x00"), "an ELF file of type 4"),
        (lambda e: patched(e, 42, b"\x10\x00"), "damaged ELF file .program headers of 16 bytes"),
        (lambda e: patched(e, 52 + 20, b"\x08\x00\x00\x00"), "bytes for 8 of memory"),
    ],
    ids=[
        *("empty", "other-format", "header", "header-only", "segment", "sections", "x86-64", "64-bit"),
        *("big-endian", "relocatable", "shared", "core-dump", "short-rows", "memory-too-small"),
    ],
)  # fmt: skip
def test_unusable_files_are_refused(change, complaint):
    """A file that is not a Cortex-M4 firmware is refused with one line."""
    with pytest.raises(FirmwareError, match=complaint) as caught:
        image.parse(change(SHIPPED), "bad.elf")
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith("bad.elf: ")


def test_big_endian_header_is_no_table_to_read():
    """A real big-endian file is refused for its byte order, not for what its fields seem to say."""
    header = b"\x7fELF\x01\x02\x01".ljust(16, b"\0") + struct.pack(">HHIIIIIHHHHHH", 2, 40, *([0] * 11))
    with pytest.raises(FirmwareError, match="32-bit big-endian"):
        image.parse(header)


def test_missing_vector_table_is_refused():
    """Flash that does not begin with a stack pointer and a reset vector is refused if they are asked for."""
    loaded = image.parse(SHIPPED)
    bare = patched(SHIPPED, SHIPPED.index(loaded.flash[:16]), bytes(16))
    with pytest.raises(FirmwareError, match=r"no vector table at 0x08000000 \(stack 0x0, reset 0x0\)"):
        image.parse(bare)
    assert image.parse(bare, vectors=None).flash[:16] == bytes(16)


@pytest.mark.parametrize(
    ("stack", "reset"),
    [
        (0x20020004, 0x08000009),
        (0x1FFFFFF0, 0x08000009),
        (0x2001C002, 0x08000009),
        (0x20000000, 0x08000009),
        (0x2001C000, 0x08000008),
        (0x2001C000, 0x08000101),
        (0x2001C000, 0x48000001),
    ],
    ids=["above-sram", "below-sram", "odd", "no-room", "arm-state", "nothing-there", "outside"],
)
def test_implausible_vectors_are_refused(stack, reset):
    """The stack must lie in RAM, and the reset vector lead, in Thumb state, to what was loaded."""
    with pytest.raises(FirmwareError, match="no vector table"):
        image.parse(elf(Part(".text", 0x08000000, vectors(stack, reset) + LOOP)))


def test_vector_table_elsewhere():
    """An image behind a boot loader is run from its own table; without being told where, it is refused."""
    behind = firmware(0x08008000)
    assert image.parse(behind, vectors=0x08008000).word(0x08008004) == 0x08008009
    with pytest.raises(FirmwareError, match=r"there is one at 0x08008000 \(--vectors 0x8008000\)"):
        image.parse(behind)
    with pytest.raises(FirmwareError, match="0x8008010: not a multiple of 512"):
        image.parse(behind, vectors=0x08008010)


def test_vector_table_in_sram():
    """An image linked to SRAM, as debuggers load them, may have its vector table there."""
    loaded = image.parse(firmware(0x20000000), vectors=0x20000000)
    assert loaded.flash == b""
    assert loaded.ram[0][0] == 0x20000000


def test_absent_file_and_folder_are_refused(tmp_path):
    """No file, and a folder, are named in the message."""
    with pytest.raises(FirmwareError, match="no such file"):
        image.load(tmp_path / "none.elf")
    with pytest.raises(FirmwareError, match="is a directory"):
        image.load(tmp_path)


def test_stripped_image():
    """A stripped file loads; a symbol asked of it is refused by saying that it has none."""
    loaded = image.parse(firmware())
    assert loaded.symbols == {}
    with pytest.raises(FirmwareError, match="has no symbols"):
        loaded.symbol("main")
    named = image.parse(firmware(symbols=(Symbol("loop", 0x08000009),)))
    with pytest.raises(FirmwareError, match="no symbol main"):
        named.symbol("main")
    assert (named.symbol("loop"), named.function_at(0x08000008)) == (0x08000008, "loop")


def test_nothing_is_found_where_nothing_was_loaded():
    """Addresses outside the image belong to no function and to no line."""
    loaded = image.parse(SHIPPED)
    for address in (0, 0x07FFFFFE, FAR, 0x20000000, 0xFFFFFFFF):
        assert loaded.word(address & ~3) is None or address == 0  # 0 is flash once more
        assert loaded.line_at(address) == ""
    assert loaded.function_at(FAR) == ""


FAR = 0x08000000 + 0xF0000


@given(st.integers(0, len(SHIPPED) - 1))
@settings(max_examples=60)
def test_every_truncation_is_refused(length):
    """However much of a file is missing at its end, it is refused with one line."""
    with pytest.raises(FirmwareError) as caught:
        image.parse(SHIPPED[:length])
    assert "\n" not in str(caught.value)


SMALL = elf(
    Part(".text", 0x08000000, vectors() + LOOP * 8),
    Part(".data", 0x20000000, b"data", load=0x08001000),
    Part(".bss", 0x20000010, kind=NOBITS, room=64),
    symbols=(Symbol("$t", 0x08000008, 0), Symbol("main", 0x08000009), Symbol("value", 0x20000000, 1)),
)


@given(st.data())
@settings(max_examples=80)
@pytest.mark.parametrize("whole", [SHIPPED, SMALL], ids=["shipped", "small"])
def test_any_flipped_bytes_load_or_are_refused(whole, data):
    """Damage of any kind is taken or refused; nothing else is raised, by the line table either."""
    broken = bytearray(whole)
    # Headers and tables are few bytes of many: half of the damage is aimed at them.
    at = st.one_of(
        st.integers(0, 200), st.integers(len(whole) - 1500, len(whole) - 1), st.integers(0, len(whole) - 1)
    )
    for _ in range(data.draw(st.integers(1, 4))):
        broken[data.draw(at) % len(whole)] = data.draw(
            st.sampled_from([0, 1, 0x7F, 0x80, 0xFF]) | st.integers(0, 255)
        )
    try:
        loaded = image.parse(bytes(broken), vectors=None)
    except FirmwareError:
        return
    assert len(loaded.flash) <= 0x100000
    assert sum(len(content) for _, content in loaded.ram) <= 0x30000
    assert isinstance(loaded.line_at(0x08000100), str)
    assert isinstance(loaded.function_at(0x08000100), str)
