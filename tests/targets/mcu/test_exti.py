"""External interrupts, by RM0090's section 12.2."""

import pytest

from targets.mcu import pins
from tests.targets.mcu.board import Board

EXTI = 0x40013C00
IMR, EMR, RTSR, FTSR, SWIER, PR = (EXTI + offset for offset in range(0, 0x18, 4))
EXTICR1, EXTICR3 = 0x40013808, 0x40013810
A, B = 0x40020000, 0x40020400


@pytest.fixture
def board():
    return Board()


@pytest.mark.parametrize(
    ("rising", "falling", "edges"), [(1, 0, [1, 0]), (0, 1, [0, 1]), (1, 1, [1, 1]), (0, 0, [0, 0])]
)
def test_edges_that_are_selected_set_the_pending_bit(board, rising, falling, edges):
    """RTSR and FTSR select the edges of a line (section 12.3.3)."""
    board[IMR], board[RTSR], board[FTSR] = 1, rising, falling
    seen = []
    for level in (1, 0):
        pins.drive_pin(board, "PA0", level)
        seen.append(board[PR])
        board[PR] = 1
    assert seen == edges


def test_port_is_selected(board):
    """A line looks at the port that SYSCFG_EXTICR names, and at no other (section 9.2.3)."""
    board[IMR] = board[RTSR] = 1 << 9
    board[EXTICR3] = 1 << 4  # line 9: port B
    pins.drive_pin(board, "PA9", 1)
    assert board[PR] == 0
    pins.drive_pin(board, "PB9", 1)
    assert board[PR] == 1 << 9


def test_pending_bit_is_cleared_by_a_one(board):
    """Writing a one clears a pending bit and no other, also by a byte (section 12.3.6)."""
    board[RTSR] = 0b11 | 1 << 8
    for pin in ("PA0", "PA1", "PA8"):
        pins.drive_pin(board, pin, 1)
    assert board[PR] == 0b11 | 1 << 8
    board.write(PR, 0b01, size=1)
    assert board[PR] == 0b10 | 1 << 8


@pytest.mark.parametrize(
    ("line", "irq"),
    list(enumerate([6, 7, 8, 9, 10, *[23] * 5, *[40] * 6, 1, 41, 42, 62, 76, 2, 3])),
)
def test_lines_reach_their_interrupts(board, line, irq):
    """Software's event on a line that IMR lets through raises its interrupt (table 61, section 12.3.5)."""
    board[SWIER] = 1 << line
    assert board[PR] == 0
    board[SWIER] = 0
    board[PR] = 1 << line
    board[IMR] = 1 << line
    board[SWIER] = 1 << line
    assert board[PR] == 1 << line
    assert board.lines() == {irq}
    board[IMR] = 0
    assert board.lines() == set()


def test_software_event_is_over_with_its_pending_bit(board):
    """SWIER is cleared with PR (section 12.3.5)."""
    board[IMR] = 1
    board[SWIER] = 1
    assert board[SWIER] == 1
    board[PR] = 1
    assert board[SWIER] == 0


def test_a_program_sees_its_own_outputs(board):
    """The input stage is on in output mode: an output's edge reaches its line (section 8.3.10)."""
    board[RTSR] = 1
    board[A] = 1
    board[A + 0x18] = 1
    assert board[PR] == 1


def test_events_are_not_modelled(board):
    """An event line that would wake the core from WFE is counted as unmodelled."""
    board[EMR] = 1
    assert board[EMR] == 1
    assert EMR in board.unmodelled
