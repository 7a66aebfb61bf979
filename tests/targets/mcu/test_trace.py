"""The trace: which functions are entered, which blocks run, when, in order, and what there is no room for."""

import gc

import numpy as np
import pytest

from targets.mcu import trace
from targets.mcu.image import parse
from targets.mcu.machine import Stm32f405
from targets.mcu.memory_map import FLASH
from targets.mcu.trace import Trace
from tests.targets.mcu.made import NOTYPE, Part, Symbol, elf, vectors

# reset: bl leaf; b reset. leaf: bx lr
CODE = vectors() + bytes.fromhex("00f0 02f8 fce7 00bf 7047")
RESET, LEAF = FLASH + 8, FLASH + 16
SYMBOLS = (Symbol("reset", RESET + 1), Symbol("leaf", LEAF + 1), Symbol("$t", RESET, NOTYPE))


@pytest.fixture
def mcu():
    return Stm32f405(parse(elf(Part(".text", FLASH, CODE), symbols=SYMBOLS)))


def test_functions_are_traced_as_they_are_entered(mcu):
    """Each entry of a function is a step, in order of time; blocks inside a function are none."""
    steps = Trace(mcu)
    mcu.run(10_000)
    taken, lost = steps.take()
    assert [step.address for step in taken[:5]] == [RESET, LEAF, RESET, LEAF, RESET]
    times = [step.t_ns for step in taken]
    assert (np.diff(times) > 0).all()
    assert times[-1] <= mcu.now_ns
    assert lost == 0


def test_blocks_are_traced_if_asked_for(mcu):
    """With every block the returns are steps, too."""
    steps = Trace(mcu, every_block=True)
    mcu.run(10_000)
    assert [step.address for step in steps.take()[0][:4]] == [RESET, LEAF, RESET + 4, RESET]


def test_steps_are_taken_once(mcu):
    """What has been taken does not come again; the trace goes on where it was."""
    steps = Trace(mcu)
    mcu.run(10_000)
    first = steps.take()[0]
    assert steps.take() == ([], 0)
    mcu.run(20_000)
    again = steps.take()[0]
    assert again[0].t_ns > first[-1].t_ns
    assert again[0].address != first[-1].address


def test_overflow_is_counted(mcu):
    """Steps beyond the room there is are counted, the first ones kept."""
    steps = Trace(mcu, every_block=True)
    mcu.run(100_000_000)
    taken, lost = steps.take()
    assert len(taken) == trace.CAPACITY
    assert taken[0].address == RESET
    assert lost > 0


def test_tracing_takes_no_time(mcu):
    """A traced run takes the cycles of one that is not."""
    plain = Stm32f405(mcu.image)
    Trace(mcu, every_block=True)
    for each in (mcu, plain):
        each.run(50_000)
    assert mcu.cycles == plain.cycles


def test_trace_that_nobody_holds_does_no_harm(mcu):
    """A machine keeps what its hooks write to, whatever becomes of the trace."""
    kept = len(mcu._watching)
    Trace(mcu)
    gc.collect()
    assert len(mcu._watching) == kept + 1
    mcu.run(10_000)
    assert mcu._watching[-1][1] > 0  # steps counted
