"""Interrupt priorities and states."""

import pytest

from targets.mcu import nvic
from targets.mcu.state import allocate

ISER, ICER, ISPR, ICPR, IPR = 0x000, 0x080, 0x100, 0x180, 0x300


@pytest.fixture
def S():
    return allocate()


def pend(S, irq, priority=0):
    nvic.write(S, ISER + 4 * (irq // 32), 1 << (irq % 32))
    nvic.write(S, ISPR + 4 * (irq // 32), 1 << (irq % 32))
    word = nvic.read(S, IPR + irq // 4 * 4)
    nvic.write(S, IPR + irq // 4 * 4, word | priority << (8 * (irq % 4)))


def test_disabled_interrupt_waits(S):
    """A pending interrupt that is not enabled is no candidate, and stays pending."""
    nvic.write(S, ISPR, 1 << 5)
    assert nvic.candidate(S) == -1
    assert nvic.read(S, ISPR) == 1 << 5


def test_most_urgent_first(S):
    """The lowest priority value wins, at equal priority the lowest number."""
    pend(S, 40, 0x20)
    pend(S, 41, 0x10)
    pend(S, 42, 0x10)
    assert nvic.candidate(S) == 41


def test_only_higher_priority_preempts(S):
    """A running handler is preempted by a smaller priority value, not by an equal one."""
    pend(S, 7, 0x40)
    nvic.enter(S, 7)
    pend(S, 8, 0x40)
    assert nvic.candidate(S) == -1
    pend(S, 9, 0x30)
    assert nvic.candidate(S) == 9
    nvic.leave(S)
    assert nvic.candidate(S) == 9


def test_entry_clears_pending(S):
    """Entering a handler makes it active and no longer pending."""
    pend(S, 7)
    nvic.enter(S, 7)
    assert nvic.read(S, ISPR) == 0
    assert nvic.read(S, 0x200) == 1 << 7
    assert nvic.current(S) == 23


def test_four_priority_bits(S):
    """The STM32F4 implements the upper four bits of each priority."""
    nvic.write(S, IPR, 0xFFFFFFFF)
    assert nvic.read(S, IPR) == 0xF0F0F0F0


def test_beyond_the_last_interrupt_is_not_modelled(S):
    """Registers past interrupt 95 are reported as unmodelled."""
    assert not nvic.write(S, ISER + 12, 1)
    assert nvic.read(S, ISER + 12) == -1
