"""Programs that do not get on: interrupts disabled or unexpected, resets, the FPU and divisions late."""

import pytest

from targets.errors import FirmwareFault
from targets.mcu import state

MS = 1_000_000
IDLE = "idle: wfi\n b idle\n"
CFSR, HFSR, MMFAR, BFAR, DFSR, SHCSR, CCR = (
    0xE000ED28,
    0xE000ED2C,
    0xE000ED34,
    0xE000ED38,
    0xE000ED30,
    0xE000ED24,
    0xE000ED14,
)
FORCED, VECTTBL, DEBUGEVT = 1 << 30, 1 << 1, 1 << 31
IACCVIOL, IBUSERR, PRECISERR, BFARVALID, STKERR, UNSTKERR = 1, 1 << 8, 1 << 9, 1 << 15, 1 << 12, 1 << 11
UNDEFINSTR, INVSTATE, NOCP, UNALIGNED, DIVBYZERO = 1 << 16, 1 << 17, 1 << 19, 1 << 24, 1 << 25


def fault_of(run, until_ns: int = MS) -> FirmwareFault:
    with pytest.raises(FirmwareFault) as caught:
        run.run(until_ns)
    return caught.value


CASES = {
    "load": ("ldr r0, =0x60000000\n bad: ldr r1, [r0, #4]", "read", PRECISERR | BFARVALID),
    "store": ("ldr r0, =0x60000000\n bad: strb r1, [r0, #4]", "write", PRECISERR | BFARVALID),
    "store-multiple": ("ldr r0, =0x2001FFF8\n bad: stm r0, {r1-r4}", "write", PRECISERR | BFARVALID),
    "flash": ("ldr r0, =0x08001000\n bad: str r0, [r0]", "flash-write", PRECISERR | BFARVALID),
    "fetch": ("ldr r0, =0x60000001\n bx r0", "fetch", IBUSERR),
    "execute-ccm": ("ldr r0, =0x10000001\n bx r0", "fetch", IBUSERR),
    "execute-peripheral": ("ldr r0, =0x40020001\n bx r0", "execute-never", IACCVIOL),
    "undefined": ("bad: udf #1", "undefined", UNDEFINSTR),
    "undefined-wide": ("bad: udf.w #1", "undefined", UNDEFINSTR),
    "double-precision": ("fpu_on\n bad: .short 0xee30, 0x0b00", "undefined", UNDEFINSTR),
    "even-branch": ("ldr r0, =bad\n bic r0, #1\n bx r0\n nop\n bad: nop", "arm-state", INVSTATE),
    "coprocessor": ("bad: cdp p0, #0, c0, c0, c0, #0", "coprocessor", NOCP),
    "fpu-off": ("movs r0, #1\n movs r1, #2\n bad: vmov.f32 s0, #1.0", "coprocessor", NOCP),
    "exclusive": ("ldr r0, =0x20000101\n bad: ldrex r1, [r0]", "unaligned", UNALIGNED),
    "division": (f"put {CCR}, 0x210\n movs r0, #0\n dsb\n isb\n bad: sdiv r1, r1, r0", "division", DIVBYZERO),
    "remainder": (f"put {CCR}, 0x210\n mov lr, #0\n dsb\n isb\n bad: udiv r1, r1, lr", "division", DIVBYZERO),
}


def test_unexpected_interrupt_is_named(program):
    """An exception whose handler is a bare endless loop ends the run: nobody expected it."""
    fault = fault_of(program("handler reset\n put 0xE000E100, 1 << 6\n put 0xE000E200, 1 << 6\n" + IDLE))
    assert fault.kind == "no-handler"
    assert "interrupt 6" in str(fault)


@pytest.mark.parametrize("loop", ["b .", IDLE, "1: nop\n nop\n b 1b"], ids=["spin", "sleep", "loop"])
@pytest.mark.parametrize("mask", ["cpsid i", "cpsid f"])
def test_interrupts_disabled_for_ever_are_named(program, loop, mask):
    """With interrupts disabled and one waiting for a second, the run ends and says which one waits."""
    run = program(
        f"""
        handler irq6
            bx lr
        handler reset
            {mask}
            put 0xE000E100, 1 << 6
            put 0xE000E200, 1 << 6
            {loop}
        """,
        patience_ns=2 * MS,
    )
    fault = fault_of(run, 100 * MS)
    assert fault.kind == "interrupts-disabled"
    assert "interrupts disabled for 0.002 s while interrupt 6 waits" in str(fault)
    assert 2 * MS <= run.mcu.now_ns < 3 * MS


def test_short_critical_sections_are_no_fault(program):
    """Interrupts disabled again and again, each time for less than the patience, are none."""
    run = program(
        """
        handler sys_tick
            bx lr
        handler reset
            put 0xE000E014, 1599
            put 0xE000E010, 7
        again:
            cpsid i
            movs r3, #255
        1:  subs r3, #1
            bne 1b
            cpsie i
            b again
        """,
        patience_ns=MS,
    )
    run.run(20 * MS)
    assert run.mcu.now_ns >= 20 * MS


def test_disabled_interrupts_with_none_waiting_are_no_fault(program):
    """A program without interrupts may keep them disabled."""
    run = program("handler reset\n cpsid i\n b .\n", patience_ns=MS)
    assert run.run(10 * MS) == []


def test_sleeping_with_interrupts_disabled_wakes(program):
    """WFI with PRIMASK set ends with a pending interrupt, whose handler runs when PRIMASK is cleared."""
    run = program(
        """
        handler sys_tick
            movs r2, #15
            b noted
        handler reset
            put 0xE000E014, 7999
            put 0xE000E010, 7
            cpsid i
            wfi
            note 1
            cpsie i
            isb
            note 2
            cpsid i
        idle:
            b idle
        """
    )
    assert run.run() == [1, 15, 2]


def test_reset_request_says_what_came_before(program):
    """A firmware that answers a fault with a reset ends the run with both named."""
    run = program(
        f"""
        handler usage_fault
            put 0xE000ED0C, 0x05FA0004
            dsb
            b .
        handler reset
            put {SHCSR}, 1 << 18
            bad: udf #0
        """
    )
    fault = fault_of(run)
    assert fault.kind == "reset"
    assert "the firmware asked for a system reset after a fault (undefined instruction at pc" in str(fault)


def test_cfsr_bits_are_cleared_by_ones(program):
    """CFSR, HFSR and DFSR clear the bits that are written as one (B3.2.15)."""
    from targets.mcu import scs

    S = program("handler reset\n" + IDLE).mcu.state
    for slot, address in ((state.CFSR, CFSR), (state.HFSR, HFSR), (state.DFSR, DFSR)):
        S[slot] = 0b111
        scs.write(S, address, 0b010)
        assert scs.read(S, address) == 0b101
    scs.write(S, MMFAR, 0x1234)
    assert scs.read(S, MMFAR) == 0x1234


def test_fpu_switched_on_within_the_block_is_on(program):
    """Access granted just before the first FP instruction, without a barrier, is in time."""
    assert program(
        f"handler reset\n put 0xE000ED88, 0xF00000\n vmov.f32 s0, #1.0\n vmov r2, s0\n bl noted\n{IDLE}"
    ).run() == [0x3F800000]


def test_late_fpu_access_by_the_fault_handler(program):
    """A NOCP handler may switch the FPU on and return to the instruction, which then runs once."""
    run = program(
        f"""
        handler usage_fault
            put 0xE000ED88, 0xF00000
            dsb
            isb
            movs r2, #6
            b noted
        handler reset
            put {SHCSR}, 1 << 18
            movs r4, #0
            adds r4, #1
            vmov s0, r4
            adds r4, #1
            mov r2, r4
            bl noted
            vmov r2, s0
            bl noted
        {IDLE}
        """
    )
    assert run.run() == [6, 2, 1]


def test_division_by_zero_gives_zero_without_the_trap(program):
    """Without CCR.DIV_0_TRP a division by zero gives zero (ARMv7-M A7.7.127)."""
    run = program(f"handler reset\n movs r0, #0\n movs r2, #7\n sdiv r2, r2, r0\n bl noted\n{IDLE}")
    assert run.run() == [0]
