"""What ends a run, and what a firmware's own fault handlers see: B1.5.14 of the ARMv7-M manual."""

import pickle

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


@pytest.mark.parametrize("name", CASES)
def test_fault_ends_the_run_by_name(program, name):
    """Each fault escalates to HardFault, whose handler is an endless loop here, with its bits and its pc."""
    code, kind, bits = CASES[name]
    run = program(f"handler reset\n ldr r7, =0x1234567\n {code}\n {IDLE}")
    fault = fault_of(run)
    assert fault.kind == kind
    assert fault.registers["cfsr"] == bits
    assert fault.registers["hfsr"] == FORCED
    assert fault.registers["r7"] == 0x1234567
    if "bad" in run.mcu.image.symbols:
        assert fault.pc == run.mcu.image.symbols["bad"]


def test_registers_are_those_of_the_faulting_instruction(program):
    """The report holds the registers as the instruction found them: neither later nor earlier ones."""
    run = program(
        """
        handler reset
            movs r1, #1
            ldr r0, =0x60000000
            movs r2, #2
            ldr r1, [r0], #4
            movs r2, #3
            b .
        """
    )
    fault = fault_of(run)
    assert [fault.registers[f"r{k}"] for k in range(3)] == [0x60000000, 1, 2]
    assert fault.registers["bfar"] == 0x60000000


def test_time_of_a_fault_counts_what_ran(program):
    """Instructions behind the faulting one are not charged, however long their block."""
    text = "handler reset\n ldr r0, =0x60000000\n ldr r1, [r0]\n"
    short, long = (program(text + "nop\n" * count + IDLE) for count in (1, 50))
    assert fault_of(short).pc == fault_of(long).pc
    assert short.mcu.cycles == long.mcu.cycles


def test_report_has_the_message_and_all_registers(program):
    """The message is one line; the report adds r0 to r12, sp, lr, pc, xpsr and the status registers."""
    fault = fault_of(program("handler reset\n movs r3, #77\n udf #0\n"))
    assert str(fault).startswith("undefined instruction at pc 0x0800")
    assert "\n" not in str(fault)
    report = fault.report()
    assert report.splitlines()[0] == str(fault)
    assert "r3 0000004d" in report
    for name in (*(f"r{k}" for k in range(13)), "sp", "lr", "pc", "xpsr", "cfsr", "hfsr", "mmfar", "bfar"):
        assert f" {name} " in report


def test_fault_crosses_processes(program):
    """A fault raised in a worker arrives with all it holds."""
    fault = fault_of(program("handler reset\n udf #0\n"))
    copy = pickle.loads(pickle.dumps(fault))
    assert (str(copy), copy.kind, copy.report()) == (str(fault), fault.kind, fault.report())


def test_stack_overflow_is_named(program):
    """A push that runs out of RAM downwards is a stack overflow, and says where the stack pointer stood."""
    fault = fault_of(program("handler reset\n deeper: push {r0-r7, lr}\n bl deeper\n"), 100 * MS)
    assert fault.kind == "stack"
    assert "stack overflow" in str(fault)
    assert fault.registers["sp"] - 36 < 0x20000000 <= fault.registers["sp"]


def test_exception_frame_outside_memory(program):
    """An exception whose frame does not fit in memory is a BusFault STKERR."""
    run = program("handler sv_call\n bx lr\n handler reset\n ldr r0, =0x20000010\n mov sp, r0\n svc #0\n")
    fault = fault_of(run)
    assert fault.kind == "stack"
    assert fault.registers["cfsr"] == STKERR
    assert fault.registers["sp"] == 0x20000010 - 32


def test_unstacking_outside_memory(program):
    """A handler that loses its stack faults at its return: UNSTKERR."""
    run = program("handler sv_call\n ldr r0, =0x30000000\n mov sp, r0\n bx lr\n handler reset\n svc #0\n")
    assert fault_of(run).registers["cfsr"] == UNSTKERR


def test_enabled_handler_runs_instead(program):
    """A UsageFault that is enabled and has a handler of its own runs it, and goes on where that says."""
    run = program(
        f"""
        handler usage_fault
            ldr r0, [sp, #24]
            adds r0, #2
            str r0, [sp, #24]
            ldr r0, ={CFSR}
            ldr r2, [r0]
            str r2, [r0]
            b noted
        handler reset
            put {SHCSR}, 1 << 18
            udf #0
            ldr r0, ={CFSR}
            ldr r2, [r0]
            bl noted
        """
        + IDLE
    )
    assert run.run() == [UNDEFINSTR, 0]
    assert run.mcu.state[state.FAULT_COUNT] == 1


def test_bus_fault_handler_finds_the_address(program):
    """BFAR holds the address, and the stacked pc the instruction, while BFARVALID is set."""
    run = program(
        f"""
        handler bus_fault
            push {{lr}}
            ldr r0, ={BFAR}
            ldr r2, [r0]
            bl noted
            ldr r2, [sp, #28]
            bl noted
            add sp, #4
            ldr r0, =after
            str r0, [sp, #24]
            ldr lr, =0xFFFFFFF9
            bx lr
        handler reset
            put {SHCSR}, 1 << 17
            ldr r0, =0x60000000
            bad: ldr r1, [r0, #8]
            nop
        .thumb_func
        after:
            note 3
        """
        + IDLE
    )
    assert run.run() == [0x60000008, run.mcu.image.symbols["bad"], 3]


def test_shared_default_handler_does_not_count(program):
    """A fault's handler that is also HardFault's is no handler of its own: the run ends."""
    run = program(
        f"""
        handler hard_fault
        handler usage_fault
            note 1
            b .
        handler reset
            put {SHCSR}, 1 << 18
            udf #0
        """
    )
    assert fault_of(run).kind == "undefined"
    assert run.noted() == []


def test_hard_fault_handler_runs_if_faults_are_taken(program):
    """With on_fault="take" HardFault's handler runs, with FORCED set, and the program may go on."""
    text = f"""
        handler hard_fault
            ldr r0, [sp, #24]
            adds r0, #2
            str r0, [sp, #24]
            ldr r0, ={HFSR}
            ldr r2, [r0]
            b noted
        handler reset
            udf #0
            note 2
        {IDLE}
    """
    assert program(text, on_fault="take").run() == [FORCED, 2]
    assert fault_of(program(text)).kind == "undefined"


def test_fault_in_its_handler_is_lockup(program):
    """A fault at the priority of HardFault cannot be taken: the core locks up, and says with what."""
    run = program(
        "handler hard_fault\n ldr r0, =0x60000000\n ldr r0, [r0]\n handler reset\n udf #0\n", on_fault="take"
    )
    fault = fault_of(run)
    assert fault.kind == "lockup"
    assert "read outside memory" in str(fault)


@pytest.mark.parametrize("spin", ["b .", "1: nop\n b 1b", "1: wfi\n b 1b"], ids=["self", "loop", "sleep"])
def test_fault_handler_that_never_returns_ends_the_run(program, spin):
    """A handler that spins ends the run: at once if it is a bare loop, else after the patience given."""
    run = program(
        f"handler hard_fault\n movs r0, #1\n {spin}\n handler reset\n udf #0\n",
        on_fault="take",
        patience_ns=MS,
    )
    fault = fault_of(run, 100 * MS)
    assert fault.kind == "undefined"
    assert "has not returned for 0.001 s" in str(fault)
    assert fault.pc == run.mcu.image.symbols["reset"] & ~1
    assert run.mcu.now_ns < 2 * MS


def test_breakpoint_without_a_debugger(program):
    """BKPT escalates to HardFault with DEBUGEVT."""
    fault = fault_of(program("handler reset\n bad: bkpt #1\n"))
    assert fault.kind == "breakpoint"
    assert fault.registers["hfsr"] == DEBUGEVT


def test_breakpoint_under_the_debug_monitor(program):
    """With DEMCR.MON_EN BKPT runs the debug monitor."""
    run = program(
        f"""
        handler debug_monitor
            ldr r0, [sp, #24]
            adds r0, #2
            str r0, [sp, #24]
            ldr r0, ={DFSR}
            ldr r2, [r0]
            b noted
        handler reset
            put 0xE000EDFC, 1 << 16
            bkpt #1
            note 2
        {IDLE}
        """
    )
    assert run.run() == [2, 2]


def test_supervisor_call_that_is_masked_escalates(program):
    """SVC where its priority does not let it run is a HardFault."""
    fault = fault_of(program("handler sv_call\n bx lr\n handler reset\n cpsid i\n svc #0\n"))
    assert fault.kind == "supervisor-call"
    assert fault.registers["hfsr"] == FORCED


def test_vector_table_outside_memory(program):
    """A vector that cannot be fetched is a HardFault VECTTBL; HardFault's cannot be fetched either."""
    fault = fault_of(program("handler reset\n put 0xE000ED08, 0x60000000\n svc #0\n"))
    assert fault.kind == "vector-table"
    assert fault.registers["hfsr"] & VECTTBL
