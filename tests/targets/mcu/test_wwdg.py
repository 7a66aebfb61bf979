"""Window watchdog, by RM0090's section 22."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from targets.mcu import events, rcc
from tests.targets.mcu.board import Board

CR, CFR, SR = 0x40002C00, 0x40002C04, 0x40002C08
RCC_CFGR, APB1ENR, APB1RSTR = 0x40023808, 0x40023840, 0x40023820
WDGA, EWI = 0x80, 1 << 9


@pytest.fixture
def board():
    return Board()


def bites_after(board):
    begin = board.now
    while not board.reset_cause:
        at = int(events.due(board.state))
        board.skip(at - board.now)
        events.service(board.state)
    return board.now - begin


def test_registers_have_their_reset_values(board):
    """CR and CFR 0x7F, SR 0 (section 22.6)."""
    assert [board[r] for r in (CR, CFR, SR)] == [0x7F, 0x7F, 0]


@given(t=st.integers(0x40, 0x7F), tb=st.integers(0, 3), ppre=st.sampled_from([0, 4, 5]))
def test_time_out(t, tb, ppre):
    """T[5:0] + 1 times 4096 x 2^WDGTB clocks of APB1 (section 22.4)."""
    board = Board()
    board[RCC_CFGR] = ppre << 10
    board[CFR] = tb << 7 | 0x7F
    board[CR] = WDGA | t
    assert bites_after(board) == ((t & 0x3F) + 1) * (4096 << tb) * {0: 1, 4: 2, 5: 4}[ppre]
    assert board.reset_cause == rcc.WINDOW_WATCHDOG


def test_counts_without_biting_until_activated(board):
    """The counter runs free while WDGA is clear (section 22.3)."""
    board[CR] = 0x7F
    board.skip(4096 * 10)
    assert board[CR] == 0x75
    board.sleep(4096 * 1000)
    assert board.reset_cause == 0


def test_feeding_in_the_window(board):
    """A reload with the counter at W or below is right (section 22.4)."""
    board[CFR] = 0x50
    board[CR] = WDGA | 0x7F
    board.sleep(4096 * 0x2F)
    board[CR] = WDGA | 0x7F
    assert board.reset_cause == 0


def test_feeding_too_early(board):
    """A reload with the counter above W asks for a reset (section 22.4)."""
    board[CFR] = 0x50
    board[CR] = WDGA | 0x7F
    board.sleep(4096 * 0x2E)
    board[CR] = WDGA | 0x7F
    assert board.reset_cause == rcc.WINDOW_WATCHDOG


def test_clearing_the_top_bit_resets_at_once(board):
    """T6 written as 0 is a software reset (section 22.4)."""
    board[CR] = WDGA | 0x3F
    assert board.reset_cause == rcc.WINDOW_WATCHDOG


def test_early_wakeup_interrupt(board):
    """EWIF rises as the counter comes to 0x40, a count before the reset, and raises interrupt 0 with EWI
    (section 22.4).
    """
    board[CFR] = EWI | 0x7F
    board[CR] = WDGA | 0x44
    assert board.sleep(4 * 4096 - 1) == 0
    assert board.lines() == set()
    board.sleep(1)
    assert board.lines() == {0}
    assert board[SR] == 1
    board[SR] = 0
    assert board.lines() == set()
    board[CR] = WDGA | 0x7F
    board.sleep(0x3F * 4096)
    assert board.lines() == {0}
    assert board.reset_cause == 0


def test_activation_and_interrupt_last_until_reset(board):
    """WDGA and EWI are cleared by a reset only (sections 22.6.1 and 22.6.2)."""
    board[CFR] = EWI | 0x7F
    board[CR] = WDGA | 0x7F
    board[CFR] = 0x7F
    board[CR] = 0x7F
    assert (board[CR], board[CFR]) == (WDGA | 0x7F, EWI | 0x7F)
    board[APB1RSTR] = 1 << 11
    assert (board[CR], board[CFR]) == (0x7F, 0x7F)


def test_other_timebase_goes_on_from_the_same_count(board):
    """WDGTB changes the pace, not the counter."""
    board[CR] = 0x7F
    board.skip(4096 * 4 + 100)
    board[CFR] = 1 << 7 | 0x7F
    assert board[CR] == 0x7B
    board.skip(8192 - 100)
    assert board[CR] == 0x7A


def test_clock_changes_keep_the_count(board):
    """Another APB prescaler changes the pace; without its clock the counter stands."""
    board[CR] = 0x7F
    board.skip(4096)
    board[RCC_CFGR] = 4 << 10
    board.skip(8192)
    assert board[CR] == 0x7D
    board[APB1ENR] &= ~(1 << 11)
    board.skip(10**6)
    board[APB1ENR] |= 1 << 11
    assert board[CR] == 0x7D
    board.skip(8192)
    assert board[CR] == 0x7C


def test_clock_writes_that_change_nothing_do_not_feed_it(board):
    """Writing RCC again and again leaves the counter alone."""
    board[CR] = WDGA | 0x41
    for _ in range(100):
        board[RCC_CFGR] = 0
        board.sleep(100)
        assert board.reset_cause == (rcc.WINDOW_WATCHDOG if board.now >= 8192 else 0)
    assert board.reset_cause == rcc.WINDOW_WATCHDOG
