"""GPIO registers and pin levels, by RM0090's section 8."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from targets.mcu import gpio, pins
from tests.targets.mcu.board import Board

A, B, C = 0x40020000, 0x40020400, 0x40020800
MODER, OTYPER, OSPEEDR, PUPDR, IDR, ODR, BSRR, LCKR, AFRL, AFRH = range(0, 0x28, 4)
HALF = st.integers(0, 0xFFFF)


@pytest.fixture
def board():
    return Board()


def test_registers_have_their_reset_values(board):
    """Ports A and B start with the debugger's pins in their alternate function, the others as inputs
    (section 8.4).
    """
    expected = {A: (0xA8000000, 0x0C000000, 0x64000000), B: (0x280, 0xC0, 0x100), C: (0, 0, 0)}
    for port, values in expected.items():
        assert tuple(board[port + register] for register in (MODER, OSPEEDR, PUPDR)) == values


@given(before=HALF, set_=HALF, reset=HALF)
def test_bit_set_reset(before, set_, reset):
    """BSRR sets and resets bits of ODR at once; set wins (section 8.4.7)."""
    board = Board()
    board[C + ODR] = before
    board[C + BSRR] = set_ | reset << 16
    assert board[C + ODR] == before & ~reset | set_
    assert board[C + BSRR] == 0


def test_half_word_write_to_bsrr_brings_nothing_with_it(board):
    """The reset half can be written alone."""
    board[C + ODR] = 0xFFFF
    board.write(C + BSRR + 2, 0x00F0, size=2)
    assert board[C + ODR] == 0xFF0F


def test_input_levels(board):
    """IDR shows what drives a pin, else its pull, else 0; an analog pin reads 0 (section 8.3.9)."""
    board[C + PUPDR] = 0b01_10_01_01
    board[C + MODER] = 0b11 << 6
    assert board[C + IDR] == 0b0011
    pins.drive(board.state, 2, 0b0111, 0b0110)
    assert board[C + IDR] == 0b0110
    pins.drive(board.state, 2, 0, 0)
    assert board[C + IDR] == 0b0011


@given(mode=HALF, kind=HALF, odr=HALF, driven=HALF, levels=HALF, pull=HALF)
def test_pin_level_is_what_drives_it_most_strongly(mode, kind, odr, driven, levels, pull):
    """Push-pull outputs win, an open drain pulls low only; then the outside, then the pull-up (8.3)."""
    board = Board()
    board[C + PUPDR] = sum((pull >> k & 1) << 2 * k for k in range(16))
    board[C + OTYPER], board[C + ODR] = kind, odr
    pins.drive(board.state, 2, driven, levels)
    board[C + MODER] = sum((mode >> k & 1) << 2 * k for k in range(16))
    for k in range(16):
        output, drain, value = mode >> k & 1, kind >> k & 1, odr >> k & 1
        if output and not (drain and value):
            expected = value
        elif driven >> k & 1:
            expected = levels >> k & 1
        else:
            expected = pull >> k & 1
        assert board[C + IDR] >> k & 1 == expected


def test_idr_is_read_only(board):
    """A write to IDR changes nothing and is no unmodelled access."""
    board[C + IDR] = 0xFFFF
    assert board[C + IDR] == 0
    assert board.unmodelled == set()


def lock(board, mask, steps=((1, 0), (0, 0), (1, 0))):
    """The key sequence: LCKK and a deviation of the pins for each write."""
    for key, other in steps:
        board[C + LCKR] = key << 16 | mask ^ other


def test_locked_pins_keep_their_configuration(board):
    """After 1, 0, 1 in LCKK the pins' configuration is frozen, not their output (section 8.4.8)."""
    lock(board, 0b10)
    assert board[C + LCKR] == 1 << 16 | 0b10
    for register in (MODER, OTYPER, OSPEEDR, PUPDR, AFRL):
        board[C + register] = 0xFFFFFFFF
    assert board[C + MODER] == 0xFFFFFFF3
    assert board[C + OTYPER] == 0xFFFD
    assert board[C + PUPDR] == board[C + OSPEEDR] == 0xFFFFFFF3
    assert board[C + AFRL] == 0xFFFFFF0F
    board[C + AFRH] = 0x12345678
    assert board[C + AFRH] == 0x12345678
    board[C + ODR] = 2
    assert board[C + ODR] == 2


@pytest.mark.parametrize(
    "steps",
    [((1, 0), (1, 0), (1, 0)), ((1, 0), (0, 4), (1, 0)), ((1, 0), (0, 0), (0, 0)), ((0, 0), (1, 0))],
    ids=["no-zero", "other-pins", "no-second-one", "short"],
)
def test_wrong_sequence_locks_nothing(board, steps):
    """Any error in the sequence aborts the lock (section 8.4.8)."""
    lock(board, 0b10, steps)
    assert not board[C + LCKR] >> 16
    board[C + MODER] = 0xC
    assert board[C + MODER] == 0xC


def test_lock_lasts_until_reset(board):
    """LCKR cannot be changed once locked; the port's reset in RCC frees the pins."""
    lock(board, 0b10)
    lock(board, 0b01)
    assert board[C + LCKR] == 1 << 16 | 0b10
    board[0x40023810] = 1 << 2
    assert board[C + LCKR] == 0


def test_ports_are_apart(board):
    """A write to one port shows at no other."""
    board[A + ODR] = 1
    assert [board[A + 0x400 * k + ODR] for k in range(9)] == [1] + [0] * 8


@pytest.mark.parametrize(("name", "place"), [("PA0", 0), ("PB3", 19), ("PI11", 139)])
def test_pins_have_names(name, place):
    """Port letter and number."""
    assert gpio.place(name) == place


@pytest.mark.parametrize("name", ["", "A0", "PJ0", "PA16", "PA", "PAx", "PA-1"])
def test_no_such_pin(name):
    """A name that is no pin's is refused with it."""
    with pytest.raises(ValueError, match=f"no pin {name}"):
        gpio.place(name)
