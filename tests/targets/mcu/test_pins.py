"""Edges of pins, with their times."""

import numpy as np
import pytest

from targets.mcu import pins
from targets.mcu.state import CYCLES_MAX, CYCLES_MIN
from tests.targets.mcu.board import Board

A, C = 0x40020000, 0x40020800
MODER, PUPDR, ODR, BSRR = 0x00, 0x0C, 0x14, 0x18


@pytest.fixture
def board():
    board = Board()
    board[A + MODER] = 1
    return board


def test_edges_carry_their_time(board):
    """Each change of an output is an edge with cycles, nanoseconds and level; writing the same is none."""
    board.skip(100)
    board[A + BSRR] = 1
    board[A + BSRR] = 1
    board.skip(1600)
    board[A + BSRR] = 1 << 16
    edges = pins.edges(board, "PA0")
    assert edges.cycles.tolist() == [100, 1700]
    assert edges.ns.tolist() == [6250, 106_250]
    assert edges.level.tolist() == [1, 0]
    assert edges.lost == 0


def test_edges_carry_both_bounds(board):
    """The optimistic and the pessimistic count travel with each edge."""
    board.skip(100)
    board.state[CYCLES_MIN] = 90
    board.state[CYCLES_MAX] = 130
    board[A + BSRR] = 1
    edges = pins.edges(board, "PA0")
    assert (edges.optimistic[0], edges.cycles[0], edges.pessimistic[0]) == (90, 100, 130)


def test_only_the_pin_asked_for(board):
    """Several pins that change at once each have their own edges."""
    board[C + MODER] = 0x55555555
    board[C + ODR] = 0b1010
    board[A + ODR] = 1
    assert [len(pins.edges(board, f"PC{k}").ns) for k in range(4)] == [0, 1, 0, 1]
    assert len(pins.edges(board, "PA0").ns) == 1


def test_inputs_have_no_edges(board):
    """What the outside does to an input is not recorded."""
    pins.drive_pin(board, "PA1", 1)
    assert pins.level(board, "PA1") == 1
    assert len(pins.edges(board, "PA1").ns) == 0


def test_old_edges_are_counted_when_they_are_lost(board):
    """The ring keeps the newest edges and says how many it has lost."""
    for _ in range(5000):
        board.skip(10)
        board[A + BSRR] = 1
        board[A + BSRR] = 1 << 16
    edges = pins.edges(board, "PA0")
    assert edges.lost == 10_000 - len(edges.ns) > 0
    assert np.all(np.diff(edges.ns) >= 0)
    assert edges.cycles[-1] == 50_000


def test_pins_are_driven_one_by_one(board):
    """Driving a pin leaves the others of its port as they are; letting go gives it back to its pull."""
    board[C + PUPDR] = 0b0101
    pins.drive_pin(board, "PC0", 0)
    pins.drive_pin(board, "PC1", 0)
    assert (pins.level(board, "PC0"), pins.level(board, "PC1")) == (0, 0)
    pins.drive_pin(board, "PC0", None)
    assert (pins.level(board, "PC0"), pins.level(board, "PC1")) == (1, 0)


def test_no_such_pin(board):
    """A pin that does not exist is refused by name."""
    with pytest.raises(ValueError, match="no pin PZ9"):
        pins.edges(board, "PZ9")
