"""What an exception keeps of the program it interrupts: FP registers, flags, stack, its return."""

import pytest

from targets.errors import FirmwareFault

ICSR, SHPR2, SHPR3, SHCSR, FPCCR, AIRCR = (
    0xE000ED04,
    0xE000ED1C,
    0xE000ED20,
    0xE000ED24,
    0xE000EF34,
    0xE000ED0C,
)
PENDSV, PENDST = 1 << 28, 1 << 26

IDLE = "idle: wfi\n b idle\n"
RETURN = "pop {pc}\n"


def pend(irq: int) -> str:
    return f"put 0xE000E200 + {irq // 32 * 4}, 1 << {irq % 32}\n dsb\n isb\n"


def enable(irq: int, priority: int = 0) -> str:
    set_priority = f"ldr r0, =0xE000E400 + {irq}\n movs r1, #{priority}\n strb r1, [r0]\n"
    return set_priority + f"put 0xE000E100 + {irq // 32 * 4}, 1 << {irq % 32}\n"


FP_PROGRAM = """
    handler irq5
        push {{lr}}
        mov r2, lr
        bl noted
        {body}
        pop {{pc}}
    handler reset
        fpu_on
        put {fpccr}, {fpccr_value}
        {use}
        {enable}
        {pend}
        mrs r2, control
        bl noted
        vmov r2, s3
        bl noted
        mov r2, sp
        bl noted
        idle: wfi
        b idle
"""


def fp_program(use: bool, body: str, fpccr: int = 0xC0000000) -> str:
    return FP_PROGRAM.format(
        body=body,
        use="vmov.f32 s3, #1.0" if use else "",
        enable=enable(5),
        pend=pend(5),
        fpccr=FPCCR,
        fpccr_value=fpccr,
    )


SPOIL = "vmov.f32 s3, #2.0\n"


@pytest.mark.parametrize("fpccr", [0xC0000000, 0x80000000], ids=["lazy", "eager"])
def test_fp_registers_survive_a_handler_that_uses_them(program, fpccr):
    """With an active FP context the frame has room for it, and S3 comes back whatever the handler did."""
    run = program(fp_program(True, SPOIL, fpccr))
    assert run.run() == [0xFFFFFFE9, 4, 0x3F800000, 0x2001C000]


def test_without_fp_context_the_frame_is_basic(program):
    """A thread that has not used the FPU has the basic frame, and finds what the handler left in S3."""
    run = program(fp_program(False, SPOIL))
    assert run.run() == [0xFFFFFFF9, 0, 0x40000000, 0x2001C000]


def test_aspen_off_leaves_fp_state_to_the_program(program):
    """With FPCCR.ASPEN clear no exception saves FP registers (B1.5.7)."""
    run = program(fp_program(True, SPOIL, 0))
    noted = run.run()
    assert (noted[0], noted[2]) == (0xFFFFFFF9, 0x40000000)


def test_lazy_stacking_costs_when_the_fpu_is_used(program):
    """Saving and restoring FP registers take 17 cycles each; a handler that does not use them saves both."""
    nothing = "vmov.f32 s3, s3\n"

    def awake(body: str, fpccr: int) -> int:
        text = fp_program(True, "ldr r0, =0xE0001004\n" + body, fpccr)
        text = text.replace("fpu_on", "fpu_on\n put 0xE0001000, 1")
        run = program(text.replace("mov r2, sp", "ldr r2, =0xE0001004\n ldr r2, [r2]"))
        return run.run()[-1]

    lazy, eager = 0xC0000000, 0x80000000
    assert awake("", eager) - awake("", lazy) == 34
    assert awake(nothing, eager) == awake(nothing, lazy)


def test_nested_lazy_context_is_stacked_once(program):
    """A second handler over one without FP context saves the thread's registers in the first one's frame."""
    run = program(
        f"""
        handler irq5
            push {{lr}}
            {pend(6)}
            pop {{pc}}
        handler irq6
            push {{lr}}
            vmov.f32 s3, #2.0
            mov r2, lr
            bl noted
            ldr r0, ={FPCCR}
            ldr r2, [r0]
            and r2, #1
            bl noted
            pop {{pc}}
        handler reset
            fpu_on
            vmov.f32 s3, #1.0
            {enable(5, 0x40)} {enable(6, 0x30)}
            {pend(5)}
            vmov r2, s3
            bl noted
            ldr r0, ={FPCCR}
            ldr r2, [r0]
            and r2, #1
            bl noted
        """
        + IDLE
    )
    assert run.run() == [0xFFFFFFF1, 0, 0x3F800000, 0]


def test_flags_and_it_blocks_survive(program):
    """APSR's flags, the GE bits among them, come back after a handler that changed them all."""
    run = program(
        f"""
        handler irq5
            movs r0, #0
            msr apsr_nzcvqg, r0
            bx lr
        handler reset
            {enable(5)}
            ldr r2, =0xF80F0000
            ldr r0, =0xE000E200
            movs r1, #1 << 5
            msr apsr_nzcvqg, r2
            str r1, [r0]
            dsb
            isb
            mrs r2, apsr
            bl noted
        """
        + IDLE
    )
    assert run.run() == [0xF80F0000]


def test_stack_alignment_can_be_switched_off(program):
    """With CCR.STKALIGN an odd multiple of four gets a word of padding, without it none (B1.5.7)."""
    text = """
        handler sv_call
            mov r2, sp
            b noted
        handler reset
            put 0xE000ED14, {ccr}
            sub sp, #4
            svc #0
            mov r2, sp
            bl noted
    """
    top = 0x2001C000 - 4
    assert program(text.format(ccr=0x200) + IDLE).run() == [top - 36, top]
    assert program(text.format(ccr=0) + IDLE).run() == [top - 32, top]


@pytest.mark.parametrize(
    ("value", "nested"),
    [
        ("0xFFFFFFF1", False),
        ("0xFFFFFFF5", False),
        ("0xFFFFFFF9", True),
    ],
    ids=["to-handler-from-the-outermost", "reserved", "to-thread-from-a-nested-one"],
)
def test_invalid_exception_return_is_a_usage_fault(program, value, nested):
    """An EXC_RETURN that does not fit what is active is an INVPC UsageFault (B1.5.8)."""
    bad = f"ldr lr, ={value}\n bx lr\n"
    run = program(
        f"""
        handler irq5
            {pend(6) if nested else bad}
            b .
        handler irq6
            {bad}
        handler reset
            {enable(5, 0x40)} {enable(6, 0x30)} {pend(5)}
        """
        + IDLE
    )
    with pytest.raises(FirmwareFault, match="invalid exception return 0xfffffff") as caught:
        run.run()
    assert caught.value.registers["cfsr"] == 1 << 18
    assert caught.value.registers["hfsr"] == 1 << 30


def test_return_to_thread_from_a_nested_handler_can_be_allowed(program):
    """With CCR.NONBASETHRDENA a nested handler may return to thread mode."""
    run = program(
        f"""
        handler irq5
            {pend(6)}
            b .
        handler irq6
            ldr r0, =frame
            mov sp, r0
            ldr lr, =0xFFFFFFF9
            bx lr
        .thumb_func
        thread:
            mrs r2, ipsr
            bl noted
            ldr r0, ={ICSR}
            ldr r2, [r0]
            and r2, #0xFF
            bl noted
        {IDLE}
        handler reset
            put 0xE000ED14, 0x201
            ldr r0, =frame
            ldr r1, =thread
            str r1, [r0, #24]
            mov r1, #1 << 24
            str r1, [r0, #28]
            {enable(5, 0x40)} {enable(6, 0x30)} {pend(5)}
            b .
        .set frame, 0x20008000
        """
    )
    assert run.run()[0] == 0


def test_exception_return_in_thread_mode_is_a_branch(program):
    """In thread mode 0xFFFFFFF9 is an address like any other, in a region that holds no code."""
    run = program("handler reset\n ldr lr, =0xFFFFFFF9\n bx lr\n")
    with pytest.raises(FirmwareFault, match="holds no code at pc 0xfffffff8"):
        run.run()


def test_empty_vector_is_arm_state(program):
    """An exception whose vector is 0 ends in a UsageFault INVSTATE at its first instruction."""
    run = program(
        "handler reset\n put 0xE000ED08, table\n svc #0\n" + IDLE + ".balign 512\n table: .fill 32, 4\n"
    )
    with pytest.raises(FirmwareFault, match="empty vector") as caught:
        run.run()
    assert caught.value.registers["pc"] == 0
    assert caught.value.registers["xpsr"] & 0x1FF == 11


def test_vector_table_can_be_moved(program):
    """VTOR says where the vectors are fetched from."""
    run = program(
        """
        handler reset
            put 0x20000400 + 4 * 11, other
            put 0xE000ED08, 0x20000400
            dsb
            svc #0
            note 2
        """
        + IDLE
        + "handler other\n movs r2, #1\n b noted\n"
    )
    assert run.run() == [1, 2]
