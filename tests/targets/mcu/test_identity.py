"""The electronic signature and the debug unit, by RM0090's sections 38.6 and 39."""

import pytest

from targets.mcu import identity
from tests.targets.mcu.board import Board


@pytest.fixture
def board():
    return Board()


def test_unique_id(board):
    """Ninety-six bits at 0x1FFF7A10, the same in every emulator, with the lot in ASCII (section 39.1)."""
    assert tuple(board[0x1FFF7A10 + 4 * k] for k in range(3)) == identity.UNIQUE_ID
    lot = b"".join(board[0x1FFF7A14 + 4 * k].to_bytes(4, "little") for k in range(2))[1:]
    assert lot.decode() == "Q425658"
    assert board.read(0x1FFF7A14, size=1) == 23


def test_flash_size(board):
    """The half-word at 0x1FFF7A22 is 1024 kB (section 39.2)."""
    assert board.read(0x1FFF7A22, size=2) == 1024


def test_boot_loader_is_not_there(board):
    """What else system memory holds is not known: counted, read as zero, never written."""
    board[0x1FFF7A10] = 0
    assert board[0x1FFF7A10] == identity.UNIQUE_ID[0]
    assert board[0x1FFF0000] == 0
    assert board.unmodelled == {0x1FFF7A10, 0x1FFF0000}


def test_device_code(board):
    """DBGMCU_IDCODE names the STM32F405 (section 38.6.1)."""
    assert board[0xE0042000] & 0xFFF == 0x413


def test_debug_registers_keep_what_is_written(board):
    """CR and the freeze registers are stored, in the bits they have (section 38.16)."""
    for address, bits in ((0xE0042004, 0xE7), (0xE0042008, 0x06E01DFF), (0xE004200C, 0x00070003)):
        board[address] = 0xFFFFFFFF
        assert board[address] == bits
    board[0xE0042000] = 0
    assert board.unmodelled == {0xE0042000}
