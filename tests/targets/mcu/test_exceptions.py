"""Exceptions in and out: nesting, tail-chaining, stacks, FP context, returns that are refused."""

import pytest

from targets.mcu import state

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


def test_supervisor_call_returns_behind_itself(program):
    """SVC runs its handler and goes on with the next instruction; the handler finds the call's number."""
    run = program(
        """
        handler sv_call
            ldr r0, [sp, #24]
            ldrb r2, [r0, #-2]
            b noted
        handler reset
            movs r7, #1
            svc #42
            note 7
        """
        + IDLE
    )
    assert run.run() == [42, 7]


def test_more_urgent_interrupt_nests(program):
    """An interrupt of higher priority runs inside the handler of a lower one, and returns into it."""
    run = program(
        f"""
        handler irq5
            push {{lr}}
            note 1
            {pend(6)}
            note 3
            {RETURN}
        handler irq6
            push {{lr}}
            note 2
            {RETURN}
        handler reset
            {enable(5, 0x40)} {enable(6, 0x30)} {pend(5)}
            note 4
        """
        + IDLE
    )
    assert run.run() == [1, 2, 3, 4]


def test_equal_priority_is_tail_chained(program):
    """An interrupt of no higher priority waits for the handler's end, and is entered without unstacking."""
    text = f"""
        handler irq5
            push {{lr}}
            {pend(6)}
            ldr r2, =0xE0001004
            ldr r2, [r2]
            bl noted
            {RETURN}
        handler irq6
            ldr r2, =0xE0001004
            ldr r2, [r2]
            b noted
        handler reset
            put 0xE0001000, 1
            {enable(5, 0x40)} {enable(6, 0x40)} {pend(5)}
    """
    run = program(text + IDLE)
    first, second = run.run()
    S = run.mcu.state
    # From reading the counter to reading it again lie the tail-chain and some instructions of either handler.
    assert S[state.TAIL_CYCLES] < second - first < S[state.TAIL_CYCLES] + 30
    assert run.mcu.registers()["sp"] == 0x2001C000


def test_system_handlers_follow_each_other_by_priority(program):
    """PendSV of lowest priority runs after SysTick and the interrupt that were pending with it."""
    run = program(
        f"""
        handler pend_sv
            movs r2, #14
            b noted
        handler sys_tick
            movs r2, #15
            b noted
        handler irq9
            movs r2, #25
            b noted
        handler reset
            put {SHPR3}, 0x80F00000
            {enable(9, 0x90)}
            cpsid i
            put {ICSR}, {PENDSV | PENDST}
            {pend(9)}
            cpsie i
            isb
            note 1
        """
        + IDLE
    )
    assert run.run() == [15, 25, 14, 1]


@pytest.mark.parametrize(
    ("mask", "unmask"),
    [
        ("cpsid i", "cpsie i"),
        ("cpsid f", "cpsie f"),
        ("movs r0, #0x40\n msr basepri, r0", "movs r0, #0\n msr basepri, r0"),
        ("movs r0, #0x40\n msr basepri_max, r0", "movs r0, #0x50\n msr basepri, r0"),
    ],
    ids=["primask", "faultmask", "basepri", "basepri_max"],
)
def test_mask_register_holds_an_interrupt_back(program, mask, unmask):
    """PRIMASK, FAULTMASK and BASEPRI hold a pending interrupt back until they are cleared, and no longer."""
    run = program(
        f"""
        handler irq5
            movs r2, #5
            b noted
        handler reset
            {enable(5, 0x40)}
            {mask}
            {pend(5)}
            note 1
            {unmask}
            isb
            note 2
        """
        + IDLE
    )
    assert run.run() == [1, 5, 2]


def test_basepri_lets_the_more_urgent_through(program):
    """BASEPRI holds back its own priority value and those above, not the ones below."""
    run = program(
        f"""
        handler irq5
            movs r2, #5
            b noted
        handler irq6
            movs r2, #6
            b noted
        handler reset
            {enable(5, 0x40)} {enable(6, 0x30)}
            movs r0, #0x40
            msr basepri, r0
            {pend(5)} {pend(6)}
            note 1
        """
        + IDLE
    )
    assert run.run() == [6, 1]


def test_faultmask_is_cleared_by_the_return(program):
    """FAULTMASK set in a handler ends with it (B1.4.3)."""
    run = program(
        f"""
        handler irq5
            cpsid f
            bx lr
        handler irq6
            movs r2, #6
            b noted
        handler reset
            {enable(5)} {enable(6)} {pend(5)}
            mrs r2, faultmask
            bl noted
            {pend(6)}
        """
        + IDLE
    )
    assert run.run() == [0, 6]


def test_nmi_passes_every_mask(program):
    """NMI runs with FAULTMASK set."""
    run = program(
        f"""
        handler nmi
            movs r2, #2
            b noted
        handler reset
            cpsid f
            put {ICSR}, 1 << 31
            dsb
            isb
            note 1
        """
        + IDLE
    )
    assert run.run() == [2, 1]


def test_handlers_run_on_the_main_stack(program):
    """Thread mode on PSP: the frame lies there, the handler has MSP and EXC_RETURN 0xFFFFFFFD (B1.5.8)."""
    run = program(
        """
        handler sv_call
            push {lr}
            mov r2, lr
            bl noted
            mrs r2, control
            bl noted
            mrs r0, psp
            ldr r2, [r0]
            bl noted
            mov r2, sp
            bl noted
            pop {pc}
        handler reset
            ldr r0, =0x20008000
            msr psp, r0
            movs r0, #2
            msr control, r0
            isb
            ldr r0, =0x1234
            svc #0
            mov r2, sp
            bl noted
            mrs r2, control
            bl noted
        """
        + IDLE
    )
    assert run.run() == [0xFFFFFFFD, 0, 0x1234, 0x2001C000 - 4, 0x20008000, 2]


def test_unprivileged_thread_returns_unprivileged(program):
    """CONTROL.nPRIV outlives exceptions; the handler itself is privileged, the thread cannot unmask."""
    run = program(
        f"""
        handler sv_call
            mrs r2, primask
            push {{lr}}
            bl noted
            cpsid i
            pop {{pc}}
        handler irq5
            movs r2, #5
            b noted
        handler reset
            put {SHPR2}, 0
            {enable(5)}
            ldr r0, =0x20008000
            msr psp, r0
            movs r0, #3
            msr control, r0
            isb
            svc #0
            put 0xE000E200, 1 << 5
            cpsie i
            isb
            mrs r2, control
            bl noted
            mrs r2, msp
            bl noted
        """
        + IDLE
    )
    assert run.run() == [0, 3, 0]


def test_handler_switches_the_threads_stack(program):
    """A handler returns to another thread by setting PSP and EXC_RETURN, as a scheduler does."""
    run = program(
        """
        handler sv_call
            ldr r0, =0x20008000
            msr psp, r0
            ldr lr, =0xFFFFFFFD
            bx lr
        handler reset
            ldr r0, =0x20008000
            movs r1, #11
            str r1, [r0]
            ldr r1, =task
            str r1, [r0, #24]
            mov r1, #1 << 24
            str r1, [r0, #28]
            svc #0
        .thumb_func
        task:
            mov r2, r0
            bl noted
            mov r2, sp
            bl noted
        """
        + IDLE
    )
    assert run.run() == [11, 0x20008020]
