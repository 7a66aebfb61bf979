"""CRC unit, by RM0090's section 4."""

import zlib

from hypothesis import given
from hypothesis import strategies as st

from tests.targets.mcu.board import Board

DR, IDR, CR = 0x40023000, 0x40023004, 0x40023008
WORDS = st.lists(st.integers(0, 0xFFFFFFFF), max_size=20)


def mirrored(value, bits):
    return int(f"{value:0{bits}b}"[::-1], 2)


@given(words=WORDS)
def test_remainder_is_that_of_ethernet_without_its_reflections(words):
    """Polynomial 0x04C11DB7 from all ones, words most significant bit first: zlib's CRC of mirrored bytes,
    mirrored and not inverted (section 4.3).
    """
    board = Board()
    for word in words:
        board[DR] = word
    data = bytes(mirrored(byte, 8) for word in words for byte in word.to_bytes(4, "big"))
    assert board[DR] == mirrored(zlib.crc32(data) ^ 0xFFFFFFFF, 32)


def test_known_value():
    """The word 0x12345678 gives 0xDF8A8A2B."""
    board = Board()
    board[DR] = 0x12345678
    assert board[DR] == 0xDF8A8A2B


def test_reset_bit_starts_again():
    """CR's RESET sets DR to all ones and leaves IDR (section 4.4.3)."""
    board = Board()
    board[IDR] = 0x1AB
    board[DR] = 1
    board[CR] = 0
    assert board[DR] != 0xFFFFFFFF
    board[CR] = 1
    assert (board[DR], board[IDR], board[CR]) == (0xFFFFFFFF, 0xAB, 0)
