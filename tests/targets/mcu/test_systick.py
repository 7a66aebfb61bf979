"""SysTick against section B3.3 of the ARMv7-M manual, count for count."""

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from targets.mcu import preemption, systick
from targets.mcu.state import ACTIVE_DEPTH, CYCLES, SYSTEM_PENDING, allocate

CTRL, LOAD, VAL, CALIB = 0x0, 0x4, 0x8, 0xC
ENABLE, TICKINT, CLKSOURCE, COUNTFLAG = 1, 2, 4, 1 << 16
IDLE = "idle: wfi\n b idle\n"


@pytest.fixture
def S():
    return fresh()


def fresh():
    S = allocate(0)
    systick.reset(S)
    return S


def advance(S, cycles: int) -> None:
    """Let time pass as the run loop does: event by event."""
    end = S[CYCLES] + cycles
    while (at := systick.due(S)) <= end:
        S[CYCLES] = at
        systick.service(S)
    S[CYCLES] = end


def pends(S) -> bool:
    return bool(S[SYSTEM_PENDING] >> preemption.SYS_TICK & 1)


def test_counts_down_and_reloads(S):
    """From LOAD to 0 and on with LOAD: a period of LOAD + 1 cycles."""
    systick.write(S, LOAD, 9)
    systick.write(S, VAL, 0)
    systick.write(S, CTRL, ENABLE | CLKSOURCE)
    seen = []
    for _ in range(13):
        advance(S, 1)
        seen.append(systick.read(S, VAL))
    assert seen == [9, 8, 7, 6, 5, 4, 3, 2, 1, 0, 9, 8, 7]


def test_countflag_is_cleared_by_reading(S):
    """COUNTFLAG is set when the count comes to 0, and cleared by reading CTRL or writing VAL."""
    systick.write(S, LOAD, 9)
    systick.write(S, CTRL, ENABLE | CLKSOURCE)
    advance(S, 9)
    assert systick.read(S, CTRL) == ENABLE | CLKSOURCE
    advance(S, 1)
    assert systick.read(S, CTRL) == ENABLE | CLKSOURCE | COUNTFLAG
    assert systick.read(S, CTRL) == ENABLE | CLKSOURCE
    advance(S, 25)
    systick.write(S, VAL, 77)
    assert systick.read(S, CTRL) == ENABLE | CLKSOURCE
    assert systick.read(S, VAL) == 0


def test_interrupt_only_with_tickint(S):
    """The exception is made pending with TICKINT; without it nothing is due, and the flag still comes."""
    systick.write(S, LOAD, 9)
    systick.write(S, CTRL, ENABLE | CLKSOURCE)
    assert systick.due(S) == systick.NEVER
    advance(S, 100)
    assert not pends(S)
    systick.write(S, CTRL, ENABLE | TICKINT | CLKSOURCE)
    advance(S, 9)
    assert not pends(S)
    advance(S, 1)
    assert pends(S)


def test_an_eighth_of_the_clock(S):
    """With CLKSOURCE clear it counts every eighth cycle."""
    systick.write(S, LOAD, 9)
    systick.write(S, CTRL, ENABLE | TICKINT)
    assert systick.due(S) == 80
    advance(S, 15)
    assert systick.read(S, VAL) == 9
    advance(S, 1)
    assert systick.read(S, VAL) == 8


def test_writing_val_restarts_without_an_interrupt(S):
    """A write clears the count, which reloads at the next cycle; that coming to 0 is no event."""
    systick.write(S, LOAD, 99)
    systick.write(S, CTRL, ENABLE | TICKINT | CLKSOURCE)
    advance(S, 50)
    systick.write(S, VAL, 5)
    assert systick.read(S, VAL) == 0
    assert not pends(S)
    advance(S, 1)
    assert systick.read(S, VAL) == 99
    assert systick.due(S) == 150


def test_new_reload_value_waits_for_the_next_zero(S):
    """LOAD written while it counts takes effect at the next reload; 0 stops it there."""
    systick.write(S, LOAD, 9)
    systick.write(S, CTRL, ENABLE | TICKINT | CLKSOURCE)
    advance(S, 4)
    systick.write(S, LOAD, 3)
    assert systick.read(S, VAL) == 6
    advance(S, 6)
    assert systick.read(S, VAL) == 0
    advance(S, 1)
    assert systick.read(S, VAL) == 3
    systick.write(S, LOAD, 0)
    advance(S, 100)
    assert systick.read(S, VAL) == 0
    assert systick.due(S) == systick.NEVER


def test_stopped_it_holds_its_count(S):
    """With ENABLE clear the count stands, and goes on from there."""
    systick.write(S, LOAD, 99)
    systick.write(S, CTRL, ENABLE | CLKSOURCE)
    advance(S, 30)
    systick.write(S, CTRL, CLKSOURCE)
    held = systick.read(S, VAL)
    advance(S, 1000)
    assert systick.read(S, VAL) == held
    systick.write(S, CTRL, ENABLE | CLKSOURCE)
    advance(S, 5)
    assert systick.read(S, VAL) == held - 5


def test_load_has_24_bits(S):
    """The upper byte of LOAD reads as zero; CALIB is read-only."""
    systick.write(S, LOAD, 0xFFFFFFFF)
    assert systick.read(S, LOAD) == 0xFFFFFF
    calibration = systick.read(S, CALIB)
    systick.write(S, CALIB, 0)
    assert systick.read(S, CALIB) == calibration == 0x4000493E


@given(
    load=st.integers(0, 40),
    pauses=st.lists(st.tuples(st.integers(0, 90), st.sampled_from(["read", "ctrl", "service"])), max_size=12),
)
def test_count_is_a_step_by_step_counter(load, pauses):
    """However it is looked at in between, count and flag are those of a counter stepped cycle by cycle."""
    S = fresh()
    systick.write(S, LOAD, load)
    systick.write(S, CTRL, ENABLE | TICKINT | CLKSOURCE)
    count, flag, expected = 0, False, 0
    for cycles, look in pauses:
        for _ in range(cycles):
            if count == 0:
                count = load
            else:
                count -= 1
                flag = flag or count == 0
                expected += count == 0
        advance(S, cycles)
        if look == "ctrl":
            assert bool(systick.read(S, CTRL) & COUNTFLAG) == flag
            flag = False
        elif look == "read":
            assert systick.read(S, VAL) == count
        else:
            systick.service(S)
    assert pends(S) == (expected > 0)


def test_ticks_come_to_the_cycle(program):
    """Handlers of consecutive ticks begin whole periods apart, by the cycle counter, out of sleep."""
    run = program(
        """
        handler sys_tick
            ldr r2, =0xE0001004
            ldr r2, [r2]
            b noted
        handler reset
            put 0xE0001000, 1
            put 0xE000E014, 15999
            put 0xE000E010, 7
        """
        + IDLE
    )
    noted = run.run(10_500_000)
    assert len(noted) == 10
    assert [b - a for a, b in pairwise(noted)] == [16000] * 9
    assert run.mcu.state[ACTIVE_DEPTH] == 0


def test_tick_without_an_interrupt_costs_no_emulation(program):
    """A program that sleeps with SysTick counting, its interrupt off, executes nothing in an hour."""
    from targets.mcu.state import HALFWORDS

    run = program("handler reset\n put 0xE000E014, 999\n put 0xE000E010, 5\n" + IDLE)
    run.run(1_000_000)
    before = int(run.mcu.state[HALFWORDS])
    run.run(3_600_000_000_000)
    assert run.mcu.state[HALFWORDS] == before
