"""Firmware images: what is taken, what is refused by name."""

import struct

import pytest

from targets.errors import FirmwareError
from targets.firmware import ELF
from targets.mcu import image


@pytest.fixture(scope="module")
def elf() -> bytes:
    return ELF["ifd"].read_bytes()


def patched(elf: bytes, offset: int, new: bytes) -> bytes:
    return elf[:offset] + new + elf[offset + len(new) :]


def test_shipped_image_has_vectors_code_and_symbols(elf):
    """The image starts with the vector table and knows its calibration section."""
    loaded = image.parse(elf)
    stack, reset = struct.unpack_from("<II", loaded.flash)
    assert stack == 0x2001C000
    assert loaded.function_at(reset & ~1) == "reset_handler"
    assert loaded.symbol("calibration_image") == 0x0800C000


def test_code_spans_leave_out_literal_pools(elf):
    """Ranges of instructions are disjoint, ordered, and less than the whole."""
    loaded = image.parse(elf)
    assert all(a < b for a, b in loaded.code)
    assert all(b <= c for (_, b), (c, _) in zip(loaded.code, loaded.code[1:], strict=False))
    assert 0 < sum(b - a for a, b in loaded.code) < len(loaded.flash)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (lambda e: b"", "not an ELF"),
        (lambda e: b"MZ" + e[2:], "not an ELF"),
        (lambda e: e[:60], "damaged ELF"),
        (lambda e: e[:3000], "truncated|damaged"),
        (lambda e: patched(e, 18, b"\x3e\x00"), "not for a little-endian ARM"),
        (lambda e: patched(e, 4, b"\x02"), "damaged|not for"),
    ],
    ids=["empty", "other-format", "header-only", "truncated", "x86-64", "64-bit"],
)
def test_unusable_files_are_refused(elf, change, complaint):
    """A file that is not a Cortex-M4 firmware is refused with one line."""
    with pytest.raises(FirmwareError, match=complaint) as caught:
        image.parse(change(elf), "bad.elf")
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith("bad.elf: ")


def test_missing_vector_table_is_refused(elf):
    """Flash that does not begin with a stack pointer and a reset vector is refused."""
    loaded = image.parse(elf)
    at = elf.index(loaded.flash[:16])
    with pytest.raises(FirmwareError, match="no vector table"):
        image.parse(patched(elf, at, bytes(16)))


def test_absent_file_and_folder_are_refused(tmp_path):
    """No file, and a folder, are named in the message."""
    with pytest.raises(FirmwareError, match="no such file"):
        image.load(tmp_path / "none.elf")
    with pytest.raises(FirmwareError, match="is a directory"):
        image.load(tmp_path)
