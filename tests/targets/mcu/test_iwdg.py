"""Independent watchdog, by RM0090's section 21."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from targets.mcu import events, rcc
from tests.targets.mcu.board import Board

KR, PR, RLR, SR = 0x40003000, 0x40003004, 0x40003008, 0x4000300C
RCC_CSR = 0x40023874
START, RELOAD, UNLOCK = 0xCCCC, 0xAAAA, 0x5555
MS = 16_000


@pytest.fixture
def board():
    return Board()


def bites_after(board):
    """Cycles until the reset is asked for, the core asleep."""
    begin = board.now
    while not board.reset_cause:
        at = int(events.due(board.state))
        board.skip(at - board.now)
        events.service(board.state)
    return board.now - begin


def test_registers_have_their_reset_values(board):
    """KR reads as 0, PR 0, RLR 0xFFF, SR 0 (section 21.4)."""
    assert [board[r] for r in (KR, PR, RLR, SR)] == [0, 0, 0xFFF, 0]


def test_stopped_until_it_is_started(board):
    """Without 0xCCCC in KR nothing happens (section 21.3)."""
    board[KR] = RELOAD
    board.sleep(100_000 * MS)
    assert board.reset_cause == 0


@given(prescaler=st.integers(0, 7), reload=st.integers(0, 0xFFF))
def test_times_out_after_its_reload_value(prescaler, reload):
    """(RLR + 1) x 4 x 2^PR periods of the 32 kHz LSI, PR of 6 and 7 alike (table 106)."""
    board = Board()
    board[KR] = UNLOCK
    board[PR], board[RLR] = prescaler, reload
    board[KR] = START
    cycles = (reload + 1) * (4 << min(prescaler, 6)) * 16_000_000 // 32_000
    assert bites_after(board) == cycles
    assert board.reset_cause == rcc.INDEPENDENT_WATCHDOG


def test_feeding_keeps_it_quiet(board):
    """0xAAAA in time starts the count again (section 21.3)."""
    board[KR] = START
    for _ in range(10):
        board.sleep(500 * MS)
        board[KR] = RELOAD
    assert board.reset_cause == 0
    assert bites_after(board) == 512 * MS


def test_feeding_too_late(board):
    """A reload after the time is over comes too late, even if nobody has looked in between."""
    board[KR] = START
    board.skip(513 * MS)
    board[KR] = RELOAD
    assert board.reset_cause == rcc.INDEPENDENT_WATCHDOG


def test_registers_are_locked(board):
    """PR and RLR take writes after 0x5555 only, and not after another key (section 21.3.2)."""
    board[PR] = board[RLR] = 3
    assert (board[PR], board[RLR]) == (0, 0xFFF)
    board[KR] = UNLOCK
    board[PR] = board[RLR] = 3
    assert (board[PR], board[RLR]) == (3, 3)
    board[KR] = RELOAD
    board[PR] = board[RLR] = 5
    assert (board[PR], board[RLR]) == (3, 3)


def test_updates_take_five_periods(board):
    """PVU and RVU stand while the new values cross to the LSI's clock (section 21.4.4)."""
    board[KR] = UNLOCK
    board[PR] = 1
    assert board[SR] == 1
    board[RLR] = 100
    assert board[SR] == 3
    board.skip(5 * 500)
    assert board[SR] == 0


def test_new_prescaler_changes_the_pace(board):
    """Counts that are left go on at the new pace."""
    board[KR] = START
    board.skip(256 * MS)
    board[KR] = UNLOCK
    board[PR] = 1
    assert bites_after(board) == 512 * MS


def test_starting_it_starts_its_oscillator(board):
    """The watchdog switches the LSI on (section 7.2.5)."""
    board[KR] = START
    board.skip(MS)
    assert board[RCC_CSR] & 3 == 3


def test_writes_to_status_do_nothing(board):
    """SR is read-only."""
    board[SR] = 3
    assert board[SR] == 0
    assert board.unmodelled == set()
