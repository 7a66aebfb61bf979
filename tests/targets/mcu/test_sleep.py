"""WFI, WFE, SEV and what wakes from them (ARMv7-M B1.5.18, B1.5.19)."""

from targets.mcu.state import HALFWORDS, SLEEPING

IDLE = "idle: wfi\n b idle\n"
MS = 1_000_000
TICK = "put 0xE000E014, 15999\n put 0xE000E010, 7\n"
TICK_HANDLER = "handler sys_tick\n movs r2, #15\n b noted\n"
SCR = 0xE000ED10


def test_wfe_sleeps_until_an_exception(program):
    """WFE without an event sleeps; the exception that ends it is one itself, kept for the next WFE."""
    run = program(
        f"""
        {TICK_HANDLER}
        handler reset
            {TICK}
            wfe
            note 1
            wfe
            note 2
            wfe
            note 3
        """
        + IDLE
    )
    assert run.run(1_500_000) == [15, 1, 2]
    assert run.run(2_500_000) == [15, 1, 2, 15, 3]


def test_send_event_is_kept_for_the_next_wfe(program):
    """SEV sets the event register: one WFE takes it and goes on, the next one sleeps."""
    run = program("handler reset\n sev\n wfe\n note 1\n sev.w\n sev\n wfe.w\n note 2\n wfe\n note 3\n" + IDLE)
    assert run.run() == [1, 2]
    assert run.mcu.state[SLEEPING]


def test_yield_is_nothing(program):
    """YIELD goes on with the next instruction."""
    assert program("handler reset\n yield\n yield.w\n note 1\n" + IDLE).run() == [1]


def test_sevonpend_wakes_from_a_disabled_interrupt(program):
    """With SEVONPEND a masked interrupt that becomes pending ends WFE; without it, it does not."""
    text = """
        handler reset
            put {scr}, {bits}
            cpsid i
            put 0xE000E014, 1599
            put 0xE000E010, 7
            wfe
            note 1
        """
    assert program(text.format(scr=SCR, bits=1 << 4) + IDLE, patience_ns=10 * MS).run() == [1]
    assert program(text.format(scr=SCR, bits=0) + IDLE, patience_ns=10 * MS).run() == []


def test_sleep_on_exit_runs_handlers_alone(program):
    """With SLEEPONEXIT the core sleeps when the last handler returns; the thread goes no further."""
    run = program(
        f"""
        {TICK_HANDLER}
        handler reset
            put {SCR}, 2
            {TICK}
            wfi
            note 1
        """
        + IDLE
    )
    assert run.run(3_500_000) == [15, 15, 15]


def test_interrupt_of_too_low_a_priority_does_not_wake(program):
    """In a handler WFI is not ended by an interrupt that could not preempt it (B1.5.19)."""
    run = program(
        f"""
        handler irq5
            push {{lr}}
            {TICK}
            wfi
            note 1
            pop {{pc}}
        {TICK_HANDLER}
        handler reset
            put 0xE000ED20, 0x80000000
            put 0xE000E404, 0x4000
            put 0xE000E100, 1 << 5
            put 0xE000E200, 1 << 5
            dsb
            isb
            note 2
        """
        + IDLE
    )
    assert run.run(5 * MS) == []


def test_basepri_keeps_an_interrupt_from_waking(program):
    """WFI is not ended by an interrupt behind BASEPRI, but by one that only PRIMASK holds back."""
    text = """
        handler reset
            put 0xE000ED20, 0x80000000
            movs r0, #0x40
            {mask}
            put 0xE000E014, 1599
            put 0xE000E010, 7
            wfi
            note 1
        spin:
            b spin
        """
    assert program(text.format(mask="msr basepri, r0")).run() == []
    assert program(text.format(mask="cpsid i")).run() == [1]


def test_sleep_passes_in_no_time(program):
    """Between two ticks nothing is executed."""
    run = program("handler sys_tick\n bx lr\n handler reset\n" + TICK + IDLE)
    run.run(100 * MS)
    before = int(run.mcu.state[HALFWORDS])
    run.run(1100 * MS)
    assert (run.mcu.state[HALFWORDS] - before) / 1000 < 10
