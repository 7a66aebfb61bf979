"""What a debugger does to the emulated MCU: registers, memory, single steps, breakpoints."""

import pytest

from targets.errors import FirmwareError
from targets.mcu.machine import BREAKPOINT, STEP, TIME, Stm32f405

MS = 1_000_000


@pytest.fixture
def mcu(image):
    return Stm32f405(image)


def test_stepping_and_running_take_the_same_time(mcu, image):
    """A program reached by single steps stands where, when and as it does when it runs freely."""
    stepped = Stm32f405(image)
    target = image.symbol("ecu_init")
    mcu.set_breakpoints([target])
    assert mcu.run(100 * MS) == BREAKPOINT
    while stepped.pc != target:
        assert stepped.step() == STEP
    assert stepped.registers() == mcu.registers()
    assert stepped.cycles == mcu.cycles


def test_step_after_a_run_is_one_instruction(mcu):
    """Code that has run before, and is translated in blocks, is stepped through one by one all the same."""
    mcu.run(MS)
    for _ in range(10):
        before = mcu.cycles
        assert mcu.step() == STEP
        assert 0 < mcu.cycles - before < 8


def test_run_leaves_a_breakpoint_behind(mcu, image):
    """Run again from a breakpoint, the program goes on to the next one; removed, none stops it."""
    first, second = image.symbol("board_init"), image.symbol("ecu_init")
    mcu.set_breakpoints([first, second])
    assert [(mcu.run(100 * MS), mcu.pc) for _ in range(2)] == [(BREAKPOINT, first), (BREAKPOINT, second)]
    mcu.set_breakpoints([])
    assert mcu.run(100 * MS) == TIME


def test_breakpoint_changes_no_time(mcu, image):
    """Stopping in the middle of a basic block and going on costs what running through costs."""
    through = Stm32f405(image)
    through.run(50 * MS)
    main = image.symbol("main")
    mcu.set_breakpoints(range(main, main + 40, 2))
    stops = 0
    while mcu.run(50 * MS) == BREAKPOINT:
        stops += 1
    assert stops > 3
    assert mcu.cycles == through.cycles


def test_registers_can_be_set(mcu):
    """What is written to a register is read from it, the program counter included."""
    mcu.set_register("r4", 0xDEADBEEF)
    mcu.set_register("pc", 0x08000101)
    assert mcu.registers()["r4"] == 0xDEADBEEF
    assert mcu.registers()["pc"] == mcu.pc == 0x08000100
    with pytest.raises(KeyError):
        mcu.set_register("r99", 0)


def test_memory_of_all_kinds_is_within_reach(mcu):
    """A debugger reads and writes RAM, flash and devices; an address without memory is named."""
    mcu.write_memory(0x40023830, b"\1\0\0\0")  # RCC_AHB1ENR: a clock for port A
    for address in (0x20000101, 0x10000003, 0x08003001, 0x40020000):
        mcu.write_memory(address, b"\x12\x34\x56")
        assert mcu.read_memory(address, 3) == b"\x12\x34\x56"
    assert mcu.read_memory(0xE000ED00, 4) == (0x410FC241).to_bytes(4, "little")
    with pytest.raises(FirmwareError, match="0x30000000"):
        mcu.read_memory(0x30000000, 1)
    with pytest.raises(FirmwareError, match="0x30000000"):
        mcu.write_memory(0x30000000, b"1")


def test_step_wakes_the_sleeping_core_only_for_an_event(mcu):
    """In WFI with nothing due a step lets time pass, to the instant asked for, and runs nothing."""
    mcu.run(1000 * MS)
    pc = mcu.pc
    assert mcu.step(1500 * MS) == TIME
    assert mcu.pc == pc
    assert 1500 * MS <= mcu.now_ns < 1500 * MS + 50  # a cycle at 22 MHz
