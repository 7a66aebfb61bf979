"""Timers TIM2 to TIM5, by RM0090's section 18."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from targets.mcu import pins
from tests.targets.mcu.board import Board
from tests.targets.mcu.ticktimer import TickTimer

TIM2, TIM3, TIM4, TIM5 = (0x40000000 + 0x400 * k for k in range(4))
CR1, CR2, SMCR, DIER, SR, EGR, CCMR1, CCMR2, CCER, CNT, PSC, ARR = range(0, 0x30, 4)
CCR1, OR = 0x34, 0x50
GPIOC = 0x40020800
CEN, UDIS, URS, OPM, DIR, ARPE = 1, 2, 4, 8, 0x10, 0x80
RCC_CFGR, APB1ENR, APB1RSTR = 0x40023808, 0x40023840, 0x40023820


@pytest.fixture
def board():
    return Board()


def start(board, timer=TIM3, psc=0, arr=99, cr1=0):
    """A timer that counts from 0 with its first clock at the next cycle but one."""
    board[timer + PSC], board[timer + ARR] = psc, arr
    board[timer + EGR] = 1
    board[timer + SR] = 0
    board[timer + CR1] = CEN | cr1
    board.skip(1)  # section 18.3.2: counting starts one clock after CEN


def test_registers_have_their_reset_values(board):
    """ARR is all ones, 32 bits wide in TIM2 and TIM5, all else zero (section 18.4)."""
    for timer, full in ((TIM2, 0xFFFFFFFF), (TIM3, 0xFFFF), (TIM4, 0xFFFF), (TIM5, 0xFFFFFFFF)):
        values = {offset: board[timer + offset] for offset in range(0, 0x44, 4) if offset != 0x30}
        assert values.pop(ARR) == full
        assert set(values.values()) == {0}


@given(
    psc=st.integers(0, 0xFFFF),
    arr=st.integers(1, 0xFFFF),
    ppre=st.sampled_from([0, 4, 5, 6, 7]),
    skipped=st.integers(0, 10**12),
)
def test_period_is_the_product_of_both_divisors(psc, arr, ppre, skipped):
    """An update comes every (PSC + 1)(ARR + 1) clocks of the timer, however much time passes at once
    (section 18.3.1).
    """
    board = Board()
    board[RCC_CFGR] = ppre << 10
    divisor = {0: 1, 4: 1, 5: 2, 6: 4, 7: 8}[ppre]
    start(board, psc=psc, arr=arr)
    board.skip(divisor - 1)
    board.skip(skipped)
    counts = skipped // (divisor * (psc + 1))
    assert board[TIM3 + CNT] == counts % (arr + 1)
    assert board[TIM3 + SR] & 1 == (counts > arr)


def test_counts_to_32_bits(board):
    """TIM2 counts on where TIM3 starts again."""
    for timer in (TIM2, TIM3):
        start(board, timer, arr=0xFFFFFFFF)
    board.skip(0x12345)
    assert board[TIM2 + CNT] == 0x12345 + 1  # started a cycle earlier
    assert board[TIM3 + CNT] == 0x2345


def test_update_interrupt_comes_on_time(board):
    """With UIE the run loop is called at the overflow; the line stays up until UIF is cleared."""
    board[TIM3 + DIER] = 1
    start(board, arr=999)
    assert board.sleep(999) == 0
    assert board.lines() == set()
    board.sleep(1)
    assert board.lines() == {29}
    board[TIM3 + SR] = 0
    assert board.lines() == set()
    assert board.sleep(10_000) == 1  # a flag that is up calls nobody again


@pytest.mark.parametrize(("timer", "irq"), [(TIM2, 28), (TIM3, 29), (TIM4, 30), (TIM5, 50)])
def test_timers_have_their_interrupts(board, timer, irq):
    """RM0090 table 61."""
    board[timer + DIER] = 1
    board[timer + EGR] = 1
    assert board.lines() == {irq}


def test_down_counter(board):
    """DIR counts from ARR to 0 and reloads (section 18.3.2)."""
    start(board, arr=9, cr1=DIR)
    assert board[TIM3 + CNT] == 0
    board[TIM3 + EGR] = 1
    assert board[TIM3 + CNT] == 9
    board[TIM3 + SR] = 0
    board.skip(9)
    assert (board[TIM3 + CNT], board[TIM3 + SR] & 1) == (0, 0)
    board.skip(1)
    assert (board[TIM3 + CNT], board[TIM3 + SR] & 1) == (9, 1)


def test_centre_aligned_counter(board):
    """Up to ARR and down to 0, an update at both turns; DIR shows the way (section 18.3.2)."""
    start(board, arr=5, cr1=0x60)
    seen = []
    for _ in range(11):
        seen.append((board[TIM3 + CNT], board[TIM3 + CR1] >> 4 & 1, board[TIM3 + SR] & 1))
        board[TIM3 + SR] = 0
        board.skip(1)
    assert [count for count, _, _ in seen] == [0, 1, 2, 3, 4, 5, 4, 3, 2, 1, 0]
    assert [down for _, down, _ in seen] == [0] * 5 + [1] * 5 + [0]
    assert [k for k, (_, _, update) in enumerate(seen) if update] == [5, 10]


def test_one_pulse_stops_at_the_update(board):
    """OPM clears CEN at the next update (section 18.3.10)."""
    start(board, arr=99, cr1=OPM)
    board.skip(5000)
    assert board[TIM3 + CR1] == OPM
    assert (board[TIM3 + CNT], board[TIM3 + SR] & 1) == (0, 1)


def test_one_pulse_starts_again_from_the_beginning(board):
    """A pulse started again has the length of the first (section 18.3.10)."""
    start(board, psc=9, arr=99, cr1=OPM)
    board.skip(1000)
    board[TIM3 + CR1] = CEN | OPM
    board.skip(1 + 9)
    assert board[TIM3 + CNT] == 0
    board.skip(1)
    assert board[TIM3 + CNT] == 1


def test_registers_keep_what_is_written(board):
    """Each register has the bits of section 18.4, EGR none; also those whose effects are not modelled."""
    bits = {
        CR2: 0xF8,
        SMCR: 0xFFF7,
        DIER: 0x5F5F,
        EGR: 0,
        CCMR1: 0xFFFF,
        CCMR2: 0xFFFF,
        CCER: 0xBBBB,
        PSC: 0xFFFF,
    }
    for offset in bits:
        board[TIM3 + offset] = 0xFFFFFFFF
    assert {offset: board[TIM3 + offset] for offset in bits} == bits


def test_preloaded_period_waits_for_the_update(board):
    """With ARPE a new ARR acts from the next period on, without it at once (section 18.3.1)."""
    start(board, arr=99, cr1=ARPE)
    board[TIM3 + ARR] = 49
    board.skip(70)
    assert board[TIM3 + CNT] == 70
    board.skip(30 + 60)
    assert board[TIM3 + CNT] == 10
    board[TIM3 + CR1] = CEN
    board[TIM3 + ARR] = 9
    board.skip(1)
    assert board[TIM3 + CNT] == 11  # past ARR: on to the end of its range


def test_counter_above_its_period_runs_through(board):
    """A counter that has passed ARR goes on to 0xFFFF and starts again without an update."""
    start(board, arr=99)
    board[TIM3 + CNT] = 0xFFF0
    board.skip(16)
    assert (board[TIM3 + CNT], board[TIM3 + SR]) == (0, 0x1E)  # the channels compare with 0
    board.skip(100)
    assert board[TIM3 + SR] & 1


def test_prescaler_is_preloaded(board):
    """A new PSC acts from the next update on (section 18.4.11)."""
    start(board, arr=99)
    board[TIM3 + PSC] = 9
    board.skip(100)
    assert board[TIM3 + CNT] == 0
    board.skip(50)
    assert board[TIM3 + CNT] == 5


def test_no_counting_with_a_period_of_zero(board):
    """The counter is blocked while ARR is 0 (section 18.4.12)."""
    start(board, arr=0)
    board.skip(1000)
    assert (board[TIM3 + CNT], board[TIM3 + SR] & 1) == (0, 0)


def test_software_update(board):
    """UG starts counter and prescaler again and loads the shadows; URS keeps it from setting UIF
    (sections 18.4.1 and 18.4.6).
    """
    start(board, psc=9, arr=99)
    board.skip(57)
    board[TIM3 + CR1] = CEN | URS
    board[TIM3 + EGR] = 1
    assert (board[TIM3 + CNT], board[TIM3 + SR]) == (0, 0)
    board.skip(9)
    assert board[TIM3 + CNT] == 0
    board.skip(1)
    assert board[TIM3 + CNT] == 1
    board[TIM3 + CR1] = CEN
    board[TIM3 + EGR] = 1
    assert board[TIM3 + SR] & 1


def test_updates_can_be_disabled(board):
    """UDIS lets the counter start again without flag or shadow load (section 18.4.1)."""
    start(board, arr=9, cr1=UDIS | ARPE)
    board[TIM3 + ARR] = 4
    board.skip(25)
    assert (board[TIM3 + CNT], board[TIM3 + SR] & 1) == (5, 0)


def test_flags_are_cleared_by_zeros(board):
    """SR is rc_w0: ones leave flags alone, by half-words and bytes too (section 18.4.5)."""
    start(board, arr=9)
    board.skip(100)
    assert board[TIM3 + SR] == 0x1F
    board[TIM3 + SR] = ~0x2 & 0xFFFF
    assert board[TIM3 + SR] == 0x1D
    board.write(TIM3 + SR, 0xFE, size=1)
    assert board[TIM3 + SR] == 0x1C
    board[TIM3 + SR] = 0xFFFF
    assert board[TIM3 + SR] == 0x1C


def test_a_stopped_counter_goes_on_where_it_was(board):
    """CEN stops the counter and lets it go on, with the prescaler where it was."""
    start(board, psc=9, arr=99)
    board.skip(25)
    board[TIM3 + CR1] = 0
    board.skip(1000)
    assert board[TIM3 + CNT] == 2
    board[TIM3 + CR1] = CEN
    board.skip(1 + 4)
    assert board[TIM3 + CNT] == 2
    board.skip(1)
    assert board[TIM3 + CNT] == 3


def test_clock_change_keeps_the_count(board):
    """A new APB prescaler changes the pace from then on."""
    start(board, arr=0xFFFF)
    board.skip(100)
    board[RCC_CFGR] = 6 << 10  # APB1 by 8, timers by 4
    board.skip(40)
    assert board[TIM3 + CNT] == 110


def test_without_its_clock_the_counter_stands(board):
    """A timer stops while its enable bit in RCC is clear."""
    start(board, arr=0xFFFF)
    board.skip(100)
    board[APB1ENR] &= ~2
    board.skip(1000)
    board[APB1ENR] |= 2
    board.skip(10)
    assert board[TIM3 + CNT] == 110


def test_reset_bit_resets_the_timer(board):
    """TIM3RST puts one timer back (section 7.3.8)."""
    for timer in (TIM3, TIM4):
        start(board, timer, arr=77)
    board[APB1RSTR] = 1 << 1
    board[APB1RSTR] = 0
    assert (board[TIM3 + ARR], board[TIM3 + CR1], board[TIM4 + ARR]) == (0xFFFF, 0, 77)


@pytest.mark.parametrize(
    ("offset", "value"),
    [(CR2, 0x80), (SMCR, 0x07), (DIER, 0x100), (EGR, 0x40), (CCMR1, 0x03), (CCMR1, 0x8000), (OR, 0xC0)],
    ids=["xor", "slave", "dma", "trigger", "trc", "clear", "remap"],
)
def test_what_is_not_modelled_is_counted(board, offset, value):
    """Slave mode, DMA, TRC, clearing by ETR and remapping are counted by their register."""
    board[TIM2 + offset] = 0
    assert board.unmodelled == set()
    board[TIM2 + offset] = value
    assert board.unmodelled == {TIM2 + offset}


def test_registers_that_only_other_timers_have(board):
    """Repetition counter, break and DMA burst registers are not there."""
    for offset in (0x30, 0x44, 0x48, 0x4C, OR, 0x54):
        assert board[TIM3 + offset] == 0
    assert board.unmodelled == {TIM3 + offset for offset in (0x30, 0x44, 0x48, 0x4C, OR, 0x54)}


PINS = ("PC6", "PC7", "PC8", "PC9")
MODES = st.lists(st.integers(0, 7), min_size=4, max_size=4)
VALUES = st.lists(st.integers(0, 14), min_size=4, max_size=4)
STEPS = st.lists(
    st.tuples(
        st.integers(0, 90),
        st.sampled_from([None, "cr1", "arr", "psc", "ccr", "cnt", "sr", "modes", "ug"]),
        st.integers(0, 0xFFFF),
    ),
    max_size=12,
)


def apply(board, model, timer, what, value):
    """The same write to both."""
    if what == "cr1":
        value = value & 0xFB & ~(DIR if value & 0x60 else 0)
        if model.cr1 & 1 and (value & 0x60 == 0) != (model.centre == 0):
            return  # section 18.4.1: not while the counter is enabled
        if value & 1 and not model.cr1 & 1:
            model.started = False
        board[timer + CR1] = value
        model.cr1 = value
    elif what == "arr":
        board[timer + ARR] = model.arr = value % 13
    elif what == "psc":
        board[timer + PSC] = model.psc = value % 4
    elif what == "ccr":
        k, value = value % 4, value // 4 % 15
        board[timer + CCR1 + 4 * k] = model.ccr[k] = value
    elif what == "cnt":
        board[timer + CNT] = model.cnt = value % 16
    elif what == "sr":
        board[timer + SR] = value
        model.sr &= value
    elif what == "modes":
        k, mode, preload = value % 4, value // 4 % 8, bool(value >> 5 & 1)
        model.modes[k], model.preload[k] = mode, preload
        configure(board, timer, model)
    elif what == "ug":
        board[timer + EGR] = 1
        if not model.cr1 & UDIS:
            model.psc_now, model.arr_now, model.ccr_now = model.psc, model.arr, list(model.ccr)
            model.sr |= 0 if model.cr1 & URS else 1
        model.prescaler, model.started = 0, True
        model.cnt = model.arr_now if not model.centre and model.down else 0
        model.down = 0 if model.centre else model.down
    model.latch()


def configure(board, timer, model):
    words = [model.modes[k] << 4 | model.preload[k] << 3 for k in range(4)]
    board[timer + CCMR1] = words[0] | words[1] << 8
    board[timer + CCMR2] = words[2] | words[3] << 8


@given(
    cr1=st.integers(0, 0xFF),
    psc=st.integers(0, 3),
    arr=st.integers(0, 12),
    ccr=VALUES,
    modes=MODES,
    steps=STEPS,
)
def test_agrees_with_a_timer_that_counts(cr1, psc, arr, ccr, modes, steps):
    """Count, direction, flags and outputs are those of a timer stepped clock by clock, whatever is written in
    between.
    """
    board, model = Board(), TickTimer(0xFFFF)
    board[GPIOC + 0x20], board[GPIOC + 0x24] = 0x22 << 24, 0x22  # TIM3 on PC6 to PC9
    board[GPIOC] = 0xAA << 12
    board[TIM3 + CCER] = 0x1111
    edges: list[list[tuple[int, int]]] = [[], [], [], []]
    started = [(0, "arr", arr), (0, "psc", psc), (0, "ug", 0), (0, "sr", 0)]
    started += [(0, "ccr", 4 * value + k) for k, value in enumerate(ccr)]
    started += [(0, "modes", k + 4 * mode) for k, mode in enumerate(modes)] + [(0, "cr1", cr1)]
    model.arr = model.arr_now = 0xFFFF
    for wait, what, value in started + steps + [(50, None, 0)]:
        for clock in range(wait):
            before = list(model.ref)
            model.clock()
            for k in range(4):
                if model.ref[k] != before[k]:
                    edges[k].append((board.now + clock + 1, model.ref[k]))
        board.skip(wait)
        assert board[TIM3 + CNT] == model.cnt
        assert board[TIM3 + CR1] >> 4 & 1 == model.down
        assert board[TIM3 + CR1] & 1 == model.cr1 & 1
        assert board[TIM3 + SR] == model.sr
        if what:
            before = list(model.ref)
            apply(board, model, TIM3, what, value)
            for k in range(4):
                if model.ref[k] != before[k]:
                    edges[k].append((board.now, model.ref[k]))
        levels = [pins.level(board, pin) for pin in PINS]
        assert levels == model.ref
    for pin, expected in zip(PINS, edges, strict=True):
        found = pins.edges(board, pin)
        assert list(zip(found.cycles.tolist(), found.level.tolist(), strict=True)) == expected
