"""Settings beyond the data sheet's limits are counted and named."""

import pytest

from targets.mcu import limits
from tests.targets.mcu.board import Board

RCC = 0x40023800
CR, PLLCFGR, CFGR = RCC, RCC + 4, RCC + 8
FLASH_ACR, PWR_CR = 0x40023C00, 0x40007000
MS = 16_000


@pytest.fixture
def board():
    return Board()


def run_at(board, n, p=0, latency=5, ppre1=5, ppre2=4, m=8):
    """SYSCLK from HSE / m * n / p with the bus prescalers and the flash latency."""
    board[FLASH_ACR] = latency
    board[CR] |= 1 << 16
    board.skip(3 * MS)
    board[PLLCFGR] = m | n << 6 | p << 16 | 1 << 22
    board[CR] |= 1 << 24
    board.skip(1 * MS)
    board[CFGR] = ppre1 << 10 | ppre2 << 13
    board[CFGR] |= 2


def test_the_part_at_its_best_is_within_its_limits(board):
    """168 MHz with five wait states, APB1 at 42 and APB2 at 84 MHz is what the part is made for."""
    run_at(board, 336)
    assert limits.warnings(board.state) == {}


@pytest.mark.parametrize(
    ("settings", "complaint"),
    [
        ({"n": 344}, "HCLK of 172000000 Hz"),
        ({"n": 336, "latency": 4}, "flash latency is too short for HCLK of 168000000 Hz"),
        ({"n": 336, "ppre1": 4}, "PCLK1 of 84000000 Hz"),
        ({"n": 336, "ppre2": 0}, "PCLK2 of 168000000 Hz"),
        ({"n": 60, "m": 8, "p": 1}, "VCO at 60000000 Hz"),
        ({"n": 200, "m": 16}, "input of 500000 Hz"),
    ],
    ids=["hclk", "latency", "apb1", "apb2", "vco", "input"],
)
def test_each_limit_has_its_words(board, settings, complaint):
    """RM0090 sections 7.2 and 7.3.2 and table 10: what is beyond them is named with its value."""
    run_at(board, **settings)
    assert any(complaint in text for text in limits.warnings(board.state))


def test_factor_that_is_not_allowed_keeps_the_pll_from_locking(board):
    """A PLLM of 0 or 1 does not lock (section 7.3.2)."""
    run_at(board, 336, m=1)
    assert not board[CR] >> 25 & 1
    assert any("does not lock" in text for text in limits.warnings(board.state))


def test_write_to_a_running_pll_is_named(board):
    """PLLCFGR written while the PLL is on is ignored, and said so."""
    run_at(board, 336)
    board[PLLCFGR] = 0
    board[PLLCFGR] = 1
    assert next(iter(limits.warnings(board.state).values())) == 2


def test_lower_voltage_scale_has_a_lower_limit(board):
    """With VOS at scale 2 HCLK may not exceed 144 MHz (section 5.4.1)."""
    board[PWR_CR] = 0
    run_at(board, 336)
    assert any("voltage scale" in text for text in limits.warnings(board.state))


@pytest.mark.parametrize("latency", range(6))
def test_latency_lowered_afterwards_is_seen(board, latency):
    """Each wait state is good for 30 MHz more (table 10), also when it is taken away later."""
    run_at(board, 120, p=0)  # 60 MHz
    board[FLASH_ACR] = latency
    assert any("latency" in text for text in limits.warnings(board.state)) == (latency < 1)
