"""Exception priorities and states, of interrupts and system exceptions alike."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from targets.mcu import nvic, preemption, scs, state
from targets.mcu.preemption import PEND_SV, SV_CALL, SYS_TICK, USAGE_FAULT
from targets.mcu.state import allocate

ISER, ICER, ISPR, ICPR, IABR, IPR = 0x000, 0x080, 0x100, 0x180, 0x200, 0x300
AIRCR, SHPR2, SHPR3, SHCSR, ICSR, STIR = (
    0xE000ED0C,
    0xE000ED1C,
    0xE000ED20,
    0xE000ED24,
    0xE000ED04,
    0xE000EF00,
)


@pytest.fixture
def S():
    return allocate(0)


def pend(S, irq, priority=0):
    nvic.write(S, ISER + 4 * (irq // 32), 1 << (irq % 32))
    nvic.write(S, ISPR + 4 * (irq // 32), 1 << (irq % 32))
    word = nvic.read(S, IPR + irq // 4 * 4)
    nvic.write(S, IPR + irq // 4 * 4, word | priority << (8 * (irq % 4)))


def test_disabled_interrupt_waits(S):
    """A pending interrupt that is not enabled is no candidate, and stays pending."""
    nvic.write(S, ISPR, 1 << 5)
    assert preemption.candidate(S) == 0
    assert nvic.read(S, ISPR) == 1 << 5


def test_most_urgent_first(S):
    """The lowest priority value wins, at equal priority the lowest number."""
    pend(S, 40, 0x20)
    pend(S, 41, 0x10)
    pend(S, 42, 0x10)
    assert preemption.candidate(S) == 16 + 41


def test_system_exceptions_compete_with_interrupts(S):
    """PendSV and SysTick have priorities in the same order as interrupts; at equal ones they go first."""
    pend(S, 3, 0x50)
    scs.write(S, SHPR3, 0x40 << 24 | 0x60 << 16)
    scs.write(S, ICSR, 1 << 28 | 1 << 26)
    assert preemption.candidate(S) == SYS_TICK
    preemption.activate(S, SYS_TICK)
    preemption.deactivate(S, SYS_TICK)
    assert preemption.candidate(S) == 16 + 3
    scs.write(S, SHPR3, 0x50 << 16)
    assert preemption.candidate(S) == PEND_SV


def test_nmi_goes_before_everything(S):
    """NMI has the fixed priority -2, under any that can be set."""
    pend(S, 3, 0)
    preemption.activate(S, 16 + 7)
    scs.write(S, ICSR, 1 << 31)
    assert preemption.candidate(S) == preemption.NMI


def test_only_higher_priority_preempts(S):
    """A running handler is preempted by a smaller priority value, not by an equal one."""
    pend(S, 7, 0x40)
    preemption.activate(S, 16 + 7)
    pend(S, 8, 0x40)
    assert preemption.candidate(S) == 0
    pend(S, 9, 0x30)
    assert preemption.candidate(S) == 16 + 9
    preemption.deactivate(S, 16 + 7)
    assert preemption.candidate(S) == 16 + 9


def test_subpriority_orders_but_does_not_preempt(S):
    """With PRIGROUP 5 bits 7 and 6 decide about preemption, bits 5 and 4 about who is next (B1.5.4)."""
    scs.write(S, AIRCR, 0x05FA0000 | 5 << 8)
    pend(S, 7, 0x70)
    preemption.activate(S, 16 + 7)
    pend(S, 8, 0x50)
    pend(S, 9, 0x40)
    assert preemption.candidate(S) == 0
    preemption.deactivate(S, 16 + 7)
    assert preemption.candidate(S) == 16 + 9
    scs.write(S, AIRCR, 0x05FA0000)
    preemption.activate(S, 16 + 7)
    assert preemption.candidate(S) == 16 + 9


def test_prigroup_needs_the_key(S):
    """AIRCR ignores a write without its key, and reads back with another (B3.2.6)."""
    scs.write(S, AIRCR, 0x12340500)
    assert scs.read(S, AIRCR) == 0xFA050000
    scs.write(S, AIRCR, 0x05FA0500)
    assert scs.read(S, AIRCR) == 0xFA050500


def test_entry_clears_pending(S):
    """Entering a handler makes it active and no longer pending."""
    pend(S, 7)
    preemption.activate(S, 16 + 7)
    assert nvic.read(S, ISPR) == 0
    assert nvic.read(S, IABR) == 1 << 7
    assert nvic.current(S) == 23


def test_four_priority_bits(S):
    """The STM32F4 implements the upper four bits of each priority, and none where there is no exception."""
    nvic.write(S, IPR, 0xFFFFFFFF)
    assert nvic.read(S, IPR) == 0xF0F0F0F0
    scs.write(S, SHPR2, 0xFFFFFFFF)
    scs.write(S, SHPR3, 0xFFFFFFFF)
    assert scs.read(S, SHPR2) == 0xF0000000
    assert scs.read(S, SHPR3) == 0xF0F000F0


def test_beyond_the_last_interrupt_is_not_modelled(S):
    """Registers past interrupt 95 are reported as unmodelled."""
    assert not nvic.write(S, ISER + 12, 1)
    assert nvic.read(S, ISER + 12) == -1
    assert not scs.write(S, STIR, 96)


def test_software_trigger_makes_an_interrupt_pending(S):
    """STIR holds the number of the interrupt to be made pending (B3.2.26)."""
    scs.write(S, STIR, 40)
    assert nvic.read(S, ISPR + 4) == 1 << 8


def test_icsr_says_what_runs_and_what_waits(S):
    """VECTACTIVE, RETTOBASE, VECTPENDING, ISRPENDING; PendSV and SysTick set and cleared (B3.2.4)."""
    RETTOBASE, ISRPENDING, PENDSTSET, PENDSVSET = 1 << 11, 1 << 22, 1 << 26, 1 << 28
    assert scs.read(S, ICSR) == RETTOBASE
    scs.write(S, SHPR3, 0x80 << 16 | 0x20 << 24)
    scs.write(S, ICSR, PENDSVSET | PENDSTSET)
    assert scs.read(S, ICSR) == PENDSVSET | PENDSTSET | SYS_TICK << 12 | RETTOBASE
    preemption.activate(S, SYS_TICK)
    pend(S, 5, 0x30)
    assert scs.read(S, ICSR) == PENDSVSET | ISRPENDING | (16 + 5) << 12 | RETTOBASE | SYS_TICK
    preemption.activate(S, 16 + 5)
    assert scs.read(S, ICSR) == PENDSVSET | PEND_SV << 12 | (16 + 5)
    scs.write(S, ICSR, 1 << 27)
    assert scs.read(S, ICSR) == 16 + 5


def test_shcsr_shows_active_and_pending_and_takes_enables(S):
    """SHCSR holds the faults' enable bits and mirrors states; its pending bits can be written (B3.2.13)."""
    USGFAULTENA, USGFAULTPENDED, SVCALLACT = 1 << 18, 1 << 12, 1 << 7
    scs.write(S, SHCSR, USGFAULTENA | USGFAULTPENDED)
    preemption.activate(S, SV_CALL)
    assert scs.read(S, SHCSR) == USGFAULTENA | USGFAULTPENDED | SVCALLACT
    scs.write(S, SHCSR, 0)
    assert scs.read(S, SHCSR) == SVCALLACT


def test_pending_fault_waits_for_its_enable_bit(S):
    """A MemManage, BusFault or UsageFault that is pending but not enabled is no candidate."""
    preemption.pend(S, USAGE_FAULT)
    assert preemption.candidate(S) == 0
    scs.write(S, SHCSR, 1 << 18 | 1 << 12)
    assert preemption.candidate(S) == USAGE_FAULT


def test_event_by_a_pending_interrupt_needs_sevonpend(S):
    """With SCR.SEVONPEND an interrupt that becomes pending is an event, once, enabled or not (B1.5.18)."""
    nvic.write(S, ISPR, 1 << 5)
    preemption.note_pending(S)
    assert S[state.EVENT] == 0
    scs.write(S, 0xE000ED10, 1 << 4)
    preemption.note_pending(S)
    assert S[state.EVENT] == 1
    S[state.EVENT] = 0
    preemption.note_pending(S)
    assert S[state.EVENT] == 0


PRIORITIES = st.integers(0, 15).map(lambda p: p << 4)


@given(
    prigroup=st.integers(0, 7),
    active=st.lists(PRIORITIES, max_size=3),
    pending=st.dictionaries(st.integers(0, 95), PRIORITIES, max_size=8),
)
def test_candidate_is_what_the_manual_says(prigroup, active, pending):
    """For any priorities: the least (priority, number) pending, if its group is under every active one's."""
    S = allocate(0)
    scs.write(S, AIRCR, 0x05FA0000 | prigroup << 8)
    for irq, priority in pending.items():
        pend(S, irq, priority)
    used = [irq for irq in range(96) if irq not in pending]
    for irq, priority in zip(used, active, strict=False):
        S[state.NVIC_PRIORITY + irq] = priority
        preemption.activate(S, 16 + irq)
    size = 2 << prigroup
    level = min((p // size for p in active), default=256)
    waiting = sorted((p, irq) for irq, p in pending.items())
    expected = 16 + waiting[0][1] if waiting and waiting[0][0] // size < level else 0
    assert preemption.candidate(S) == expected
