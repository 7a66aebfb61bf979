"""The clock tree and the reset flags, by RM0090's section 7."""

import pytest

from targets.mcu import rcc
from targets.mcu.state import HZ, RESET_CAUSE
from tests.targets.mcu.board import Board

RCC = 0x40023800
CR, PLLCFGR, CFGR, CIR, AHB1RSTR, APB1ENR, BDCR, CSR = (
    RCC + offset for offset in (0x00, 0x04, 0x08, 0x0C, 0x10, 0x40, 0x70, 0x74)
)
PWR_CR, FLASH_ACR = 0x40007000, 0x40023C00
HSEON, HSERDY, PLLON, PLLRDY = 1 << 16, 1 << 17, 1 << 24, 1 << 25
MS = 16_000  # cycles at 16 MHz


@pytest.fixture
def board():
    return Board()


def pll(board, m=8, n=336, p=0, hse=True):
    """Bring the PLL up as start-up code does; a flash latency of 5 first."""
    board[FLASH_ACR] = 5
    if hse:
        board[CR] |= HSEON
        board.skip(3 * MS)
    board[PLLCFGR] = m | n << 6 | p << 16 | hse << 22 | 4 << 24
    board[CR] |= PLLON
    board.skip(1 * MS)


def test_starts_on_the_internal_oscillator(board):
    """After reset HSI is on and ready and drives SYSCLK at 16 MHz (section 7.2.2)."""
    assert board[CR] == 0x83
    assert board[CFGR] == 0
    assert rcc.frequency(board.state) == 16_000_000


def test_registers_have_their_reset_values(board):
    """Registers of section 7.3 read as the manual says after power-on."""
    board = Board(clocks=False)
    expected = {PLLCFGR: 0x24003010, CIR: 0, RCC + 0x30: 0x00100000, APB1ENR: 0, RCC + 0x50: 0x7E6791FF}
    expected |= {RCC + 0x60: 0x36FEC9FF, RCC + 0x64: 0x00075F33, BDCR: 0, CSR: 0x0E000000}
    expected |= {RCC + 0x80: 0, RCC + 0x84: 0x20003000}
    assert {address: board[address] for address in expected} == expected


@pytest.mark.parametrize(
    ("m", "n", "p", "hz"), [(8, 176, 3, 22_000_000), (8, 336, 1, 84_000_000), (8, 336, 0, 168_000_000)]
)
def test_pll_sets_the_frequency(board, m, n, p, hz):
    """HSE / M * N / P is the CPU's clock (section 7.3.2)."""
    pll(board, m, n, p)
    board[CFGR] = 2
    assert board.state[HZ] == hz
    assert board[CFGR] >> 2 & 3 == 2


def test_pll_runs_from_the_internal_oscillator(board):
    """Without PLLSRC the PLL is fed from HSI."""
    pll(board, m=16, n=336, p=3, hse=False)
    board[CFGR] = 2
    assert board.state[HZ] == 42_000_000


def test_oscillators_take_time(board):
    """HSERDY follows HSEON after the crystal's start-up time, PLLRDY PLLON after the lock time."""
    board[CR] |= HSEON
    assert not board[CR] & HSERDY
    board.skip(2 * MS)
    assert board[CR] & HSERDY
    board[PLLCFGR] = 8 | 336 << 6 | 1 << 22
    board[CR] |= PLLON
    assert not board[CR] & PLLRDY
    board.skip(MS // 10)
    assert board[CR] & PLLRDY


def test_pll_without_its_source_never_locks(board):
    """A PLL fed from HSE locks after HSE is there, and never if it is off."""
    board[PLLCFGR] = 8 | 336 << 6 | 1 << 22
    board[CR] |= PLLON
    board.skip(1000 * MS)
    assert not board[CR] & PLLRDY


def test_switch_waits_for_the_oscillator(board):
    """SW written before the oscillator is ready: SWS and the clock follow when it is (7.2.6)."""
    board[CR] |= HSEON
    board[CFGR] = 1
    assert board[CFGR] >> 2 & 3 == 0
    board.sleep(3 * MS)
    assert board[CFGR] >> 2 & 3 == 1
    assert board.state[HZ] == 8_000_000


def test_what_drives_the_core_stays_on(board):
    """HSION, HSEON and PLLON cannot be cleared while they feed SYSCLK (section 7.3.1)."""
    board[CR] = 0
    assert board[CR] & 1
    pll(board)
    board[CFGR] = 2
    board[CR] = 0
    assert board[CR] & (HSEON | PLLON) == HSEON | PLLON
    assert not board[CR] & 1


@pytest.mark.parametrize(
    ("hpre", "hz"), [(0x70, 16e6), (0x80, 8e6), (0xB0, 1e6), (0xC0, 25e4), (0xF0, 31250)]
)
def test_ahb_prescaler_divides(board, hpre, hz):
    """HPRE of 8 to 15 divides by 2 to 512, without 32 (section 7.3.3)."""
    board[CFGR] = hpre
    assert board.state[HZ] == hz


@pytest.mark.parametrize(("ppre", "bus", "timer"), [(0, 16, 16), (4, 8, 16), (5, 4, 8), (6, 2, 4), (7, 1, 2)])
def test_apb_prescalers_divide(board, ppre, bus, timer):
    """PPRE divides by 1 to 16; timers run at twice the bus clock unless that is undivided (section 7.2)."""
    board[CFGR] = ppre << 10 | ppre << 13
    assert rcc.apb1_hz(board.state) == rcc.apb2_hz(board.state) == bus * 1_000_000
    assert board.state[HZ] // rcc.timer_divisor(board.state) == timer * 1_000_000


def test_pll_settings_are_locked_while_it_runs(board):
    """PLLCFGR cannot be written while the PLL is on (section 7.3.2)."""
    pll(board)
    before = board[PLLCFGR]
    board[PLLCFGR] = 8 | 100 << 6 | 1 << 22
    assert board[PLLCFGR] == before


def test_ready_interrupt(board):
    """With HSERDYIE the oscillator's readiness sets HSERDYF and raises RCC's line until it is cleared
    (section 7.3.4).
    """
    board[CIR] = 1 << 11
    board[CR] |= HSEON
    assert board.lines() == set()
    board.sleep(3 * MS)
    assert board[CIR] & 0xFF == 1 << 3
    assert board.lines() == {5}
    board[CIR] = 1 << 11 | 1 << 19
    assert board.lines() == set()


def test_lsi_gets_ready(board):
    """LSION, then LSIRDY (section 7.3.21)."""
    board[CSR] = 1
    assert not board[CSR] & 2
    board.skip(MS)
    assert board[CSR] & 3 == 3


def test_backup_domain_is_write_protected(board):
    """BDCR takes writes only with PWR_CR_DBP; LSE then needs two seconds (section 7.3.20)."""
    board[BDCR] = 1
    assert board[BDCR] == 0
    board[PWR_CR] = 1 << 8
    board[BDCR] = 1
    assert board[BDCR] == 1
    board.skip(2000 * MS)
    assert board[BDCR] == 3
    board[BDCR] = 1 << 16
    assert board[BDCR] == 1 << 16


@pytest.mark.parametrize(
    ("cause", "flag"),
    [(rcc.SOFTWARE, 28), (rcc.INDEPENDENT_WATCHDOG, 29), (rcc.WINDOW_WATCHDOG, 30)],
    ids=["software", "independent", "window"],
)
def test_reset_flags_say_why(board, cause, flag):
    """CSR gathers the causes of resets beside PINRSTF until RMVF clears them (section 7.3.21)."""
    board[CSR] = 1 << 24
    assert board[CSR] & 0xFE000000 == 0
    rcc.reset(board.state, cause)
    assert board[CSR] & 0xFE000000 == 1 << flag | 1 << 26


def test_backup_domain_survives_a_system_reset(board):
    """A system reset leaves BDCR alone (section 7.1.1)."""
    board[PWR_CR] = 1 << 8
    board[BDCR] = 1
    rcc.reset(board.state, rcc.SOFTWARE)
    assert board[BDCR] & 1
    rcc.reset(board.state)
    assert board[BDCR] == 0


def test_unimplemented_bits_read_as_zero(board):
    """Enable and reset registers keep only the bits that this part has."""
    board[RCC + 0x3C] = 1
    assert RCC + 0x3C in board.unmodelled
    board[APB1ENR] = 0xFFFFFFFF
    assert board[APB1ENR] == 0x36FEC9FF


def test_power_on_is_no_requested_reset(board):
    """Nobody has asked for a reset after power-on."""
    assert board.state[RESET_CAUSE] == 0
    assert board.reset_cause == 0
