"""Interrupt lines."""

from tests.targets.mcu.board import Board


def test_no_line_is_up_after_reset():
    """Nobody asks for an interrupt after reset."""
    assert Board().lines() == set()
