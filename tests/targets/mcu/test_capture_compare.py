"""Capture/compare channels of the timers, by RM0090's sections 18.3.4 to 18.3.10."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from targets.mcu import events, pins
from targets.mcu.gpio import TIMER_PINS, place
from tests.targets.mcu.board import Board
from tests.targets.mcu.ticktimer import TickTimer

TIM2, TIM3 = 0x40000000, 0x40000400
CR1, DIER, SR, EGR, CCMR1, CCMR2, CCER, CNT, PSC, ARR, CCR1 = (
    TIM3 + offset for offset in (0x00, 0x0C, 0x10, 0x14, 0x18, 0x1C, 0x20, 0x24, 0x28, 0x2C, 0x34)
)
GPIOC = 0x40020800
MODER, IDR, AFRL = GPIOC, GPIOC + 0x10, GPIOC + 0x20


@pytest.fixture
def board():
    """TIM3's channels 1 and 2 on PC6 and PC7."""
    board = Board()
    board[AFRL] = 0x22 << 24
    board[MODER] = 0xA << 12
    return board


def start(board, arr, cr1=0):
    board[ARR] = arr
    board[EGR] = 1
    board[SR] = 0
    board[CR1] = 1 | cr1
    board.skip(1)


def test_pwm_on_a_pin(board):
    """PWM mode 1: high from the start of the period to CCR, at the pin, by exact times (section 18.3.9)."""
    board[CCMR1], board[CCER], board[CCR1] = 6 << 4, 1, 30
    start(board, arr=99)
    first = board.now
    board.skip(250)
    edges = pins.edges(board, "PC6")
    assert (edges.cycles[1:] - first).tolist() == [30, 100, 130, 200, 230]
    assert edges.level.tolist() == [1, 0, 1, 0, 1, 0]


@pytest.mark.parametrize(("ccr", "levels"), [(0, {0}), (100, {1}), (50, {0, 1})])
def test_pwm_reaches_both_ends(board, ccr, levels):
    """CCR 0 never, CCR above ARR always (section 18.3.9)."""
    board[CCMR1], board[CCER], board[CCR1] = 6 << 4, 1, ccr
    start(board, arr=99)
    seen = set()
    for _ in range(100):
        seen.add(pins.level(board, "PC6"))
        board.skip(1)
    assert seen == levels


def test_polarity_turns_the_pin(board):
    """CCxP inverts the output (section 18.4.9)."""
    board[CCMR1], board[CCER], board[CCR1] = 6 << 4, 3, 30
    start(board, arr=99)
    assert pins.level(board, "PC6") == 0
    board.skip(30)
    assert pins.level(board, "PC6") == 1


def test_channel_that_is_off_leaves_the_pin(board):
    """Without CCxE, and without the pin's alternate function, the channel does not drive (section 18.4.9)."""
    board[0x4002080C] = 1 << 12  # pull-up
    board[CCMR1] = 4 << 4  # forced inactive
    assert pins.level(board, "PC6") == 1
    board[CCER] = 1
    assert pins.level(board, "PC6") == 0
    board[MODER] = 0
    assert pins.level(board, "PC6") == 1
    board[MODER] = 2 << 12
    assert pins.level(board, "PC6") == 0
    board[AFRL] = 7 << 24
    assert pins.level(board, "PC6") == 1


@pytest.mark.parametrize(
    ("timer", "channel", "pin"),
    [
        (timer, channel, pin)
        for timer, channels in enumerate(TIMER_PINS)
        for channel, names in enumerate(channels)
        for pin in names
    ],
)
def test_channels_reach_their_pins(timer, channel, pin):
    """Each pin of DS8626 table 9 follows its channel in the right alternate function, and in no other."""
    board, at = Board(), 0x40000000 + 0x400 * timer
    port, number = 0x40020000 + 0x400 * (place(pin) // 16), place(pin) % 16
    board[port + 0x0C] = 0
    board[port] = 2 << 2 * number
    board[at + 0x18 + 4 * (channel // 2)] = 5 << (4 + 8 * (channel % 2))  # forced active
    board[at + 0x20] = 1 << 4 * channel
    followed = []
    for function in range(16):
        board[port + 0x20 + 4 * (number // 8)] = function << 4 * (number % 8)
        if pins.level(board, pin):
            followed.append(function)
    assert followed == [1 if timer == 0 else 2]


def test_toggling_output(board):
    """Mode 3 toggles at each match, also over many periods that nobody has looked at (section 18.3.8)."""
    board[CCMR1], board[CCER], board[CCR1] = 3 << 4, 1, 30
    start(board, arr=99)
    board.skip(35 + 100 * 7)
    assert pins.level(board, "PC6") == 0
    board.skip(100 * 1001)
    assert pins.level(board, "PC6") == 1


def test_toggling_output_that_no_pin_follows(board):
    """The level is right also if the channel was off while it toggled."""
    board[CCMR1], board[CCR1] = 3 << 4, 30
    start(board, arr=99)
    board.skip(35 + 100 * 7_000_000)
    board[CCER] = 1
    assert pins.level(board, "PC6") == 1


def test_preloaded_compare_waits_for_the_update(board):
    """OCxPE: a new CCR acts from the next period on (section 18.3.9)."""
    board[CCMR1], board[CCER], board[CCR1] = 6 << 4 | 8, 1, 30
    start(board, arr=99)
    first = board.now
    board[CCR1] = 60
    board.skip(200)
    edges = pins.edges(board, "PC6")
    assert (edges.cycles[-3:] - first).tolist() == [100, 160, 200]


@pytest.mark.parametrize(("cms", "flagged"), [(1, [14]), (2, [6]), (3, [6, 14])])
def test_centre_aligned_flags(board, cms, flagged):
    """CMS says whether a match sets the flag on the way down, up or both (section 18.4.1)."""
    board[CCR1] = 6
    start(board, arr=10, cr1=cms << 5)
    seen = []
    for count in range(20):
        if board[SR] & 2:
            seen.append(count)
        board[SR] = 0
        board.skip(1)
    assert seen == flagged


def test_compare_out_of_reach_flags_the_turn(board):
    """With CCR above ARR the flag comes with the overflow (section 18.4.5)."""
    board[CCR1] = 200
    start(board, arr=99)
    board.skip(99)
    assert board[SR] & 2 == 0
    board.skip(1)
    assert board[SR] & 2


def test_software_compare_event(board):
    """CCxG sets the channel's flag (section 18.4.6)."""
    board[EGR] = 1 << 2
    assert board[SR] == 1 << 2


@given(
    cr1=st.sampled_from([0x01, 0x11, 0x21, 0x41, 0x61]),
    psc=st.integers(0, 3),
    arr=st.integers(2, 40),
    ccr=st.lists(st.integers(0, 42), min_size=4, max_size=4),
    enabled=st.integers(1, 0x1F),
)
def test_interrupts_come_on_the_cycle(cr1, psc, arr, ccr, enabled):
    """The run loop is called at the very clock at which the first enabled flag rises, and never later."""
    board, model = Board(), TickTimer(0xFFFF, cr1=cr1)
    board[PSC], board[ARR], board[CR1] = psc, arr, cr1 & ~1
    board[EGR] = 1
    for k in range(4):
        board[CCR1 + 4 * k] = ccr[k]
    board[SR] = 0
    board[DIER] = enabled
    board[CR1] = cr1
    model.psc_now, model.arr_now, model.ccr_now = psc, arr, list(ccr)
    model.psc, model.arr, model.ccr, model.down = psc, arr, list(ccr), int(cr1 == 0x11)
    model.cnt = arr if model.down else 0
    first = 0
    while not model.sr & enabled:
        model.clock()
        first += 1
    while board.now < first:
        assert board.lines() == set()
        at = int(events.due(board.state))
        assert board.now < at <= first
        board.skip(at - board.now)
        events.service(board.state)
    assert board.lines() == {29}


def capture(board, ccmr1, ccer):
    board[CCMR1], board[CCER] = ccmr1, ccer
    start(board, arr=0xFFFF)


@pytest.mark.parametrize(
    ("polarity", "captured"), [(0b0001, [10, 30]), (0b0011, [20, 40]), (0b1011, [10, 20, 30, 40])]
)
def test_capture(board, polarity, captured):
    """The counter is kept at the selected edges of the pin; reading CCR clears the flag (section 18.3.5)."""
    capture(board, 1, polarity)
    kept = []
    for level in (1, 0, 1, 0):
        board.skip(10)
        pins.drive_pin(board, "PC6", level)
        if board[SR] & 2:
            kept.append(board[CCR1])
        assert board[SR] & 2 == 0
    assert kept == captured


def test_capture_raises_its_interrupt(board):
    """CC1IE with a capture (section 18.4.4)."""
    board[DIER] = 2
    capture(board, 1, 1)
    pins.drive_pin(board, "PC6", 1)
    assert board.lines() == {29}
    assert board[CCR1] == 0
    assert board.lines() == set()


def test_overcapture(board):
    """A second capture before the first was read sets CC1OF, and is the one kept (section 18.4.5)."""
    capture(board, 1, 1)
    for _ in range(2):
        board.skip(5)
        pins.drive_pin(board, "PC6", 1)
        board.skip(5)
        pins.drive_pin(board, "PC6", 0)
    assert board[SR] & 0x202 == 0x202
    assert board[CCR1] == 15


def test_neighbour_input_measures_a_pulse(board):
    """CC2S = 2 captures channel 1's pin in channel 2: period and pulse width of one pin (18.3.6)."""
    capture(board, 1 | 2 << 8, 0x31)
    board.skip(7)
    pins.drive_pin(board, "PC6", 1)
    board.skip(5)
    pins.drive_pin(board, "PC6", 0)
    assert board[SR] == 2 | 4
    assert (board[CCR1], board[CCR1 + 4]) == (7, 12)
    assert board[SR] == 0


def test_capture_prescaler(board):
    """ICxPSC captures every eighth edge (section 18.4.7)."""
    capture(board, 1 | 3 << 2, 1)
    kept = []
    for edge in range(1, 21):
        if edge == 20:  # switched off, the prescaler starts again
            board[CCER] = 0
            board[CCER] = 1
        board.skip(10)
        pins.drive_pin(board, "PC6", 1)
        pins.drive_pin(board, "PC6", 0)
        if board[SR] & 2:
            kept.append(board[CCR1])
    assert kept == [80, 160]
    for _ in range(7):
        assert board[SR] & 2 == 0
        pins.drive_pin(board, "PC6", 1)
        pins.drive_pin(board, "PC6", 0)
    assert board[SR] & 2


def test_captured_value_is_read_only(board):
    """A capture register cannot be written, and a narrow write of another register does not read it."""
    capture(board, 1, 1)
    board.skip(9)
    pins.drive_pin(board, "PC6", 1)
    board.write(CCR1, 5, size=2)
    assert board[SR] & 2
    assert board[CCR1] == 9


def test_software_capture(board):
    """CCxG captures in capture mode (section 18.4.6)."""
    capture(board, 1, 1)
    board.skip(21)
    board[EGR] = 2
    assert board[CCR1] == 21


def test_channel_that_is_off_captures_nothing(board):
    """Without CCxE there is no capture (section 18.4.9)."""
    capture(board, 1, 0)
    pins.drive_pin(board, "PC6", 1)
    assert board[SR] & 2 == 0
