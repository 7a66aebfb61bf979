"""Exception entry, return and tail-chaining (ARMv7-M B1.5.6 to B1.5.8), FP context and stacks included.

unicorn keeps the banked stack pointers and CONTROL, and sets CONTROL.FPCA at the first FP instruction; the
rest is done here. Belongs here: one exception in, one out. Never: which one is next.
"""

from unicorn import arm_const as arm

from targets.jit import njit
from targets.mcu import faulting, faults, memory, native, nvic, preemption
from targets.mcu.faulting import REG_LR, REG_R0, REG_SP, REG_XPSR
from targets.mcu.preemption import NMI, REG_CONTROL, REG_FAULTMASK, REG_IPSR
from targets.mcu.state import (
    ACTIVE_DEPTH,
    CCR,
    CYCLES,
    CYCLES_MAX,
    CYCLES_MIN,
    ENTRY_CYCLES,
    ERROR,
    EVENT,
    EXIT_CYCLES,
    FPCAR,
    FPCCR,
    NEXT,
    PC,
    SCR,
    SLEEPING,
    TAIL_CYCLES,
    THUMB,
    VTOR,
    State,
)

REG_R12, REG_S0, REG_FPSCR = arm.UC_ARM_REG_R12, arm.UC_ARM_REG_S0, arm.UC_ARM_REG_FPSCR
REG_MSP, REG_PSP = arm.UC_ARM_REG_MSP, arm.UC_ARM_REG_PSP
REG_XPSR_ALL, REG_FLAGS = arm.UC_ARM_REG_XPSR_NZCVQG, arm.UC_ARM_REG_APSR_NZCV

BASIC_FRAME, FP_FRAME = 32, 104
FP_CONTEXT_CYCLES = 17
"""S0 to S15 and FPSCR, a word a cycle, when they are stacked or unstacked."""

NPRIV, SPSEL, FPCA = 1, 2, 4  # CONTROL
ASPEN, LSPEN, LSP_THREAD, LSPACT = 1 << 31, 1 << 30, 1 << 3, 1  # FPCCR
STKALIGN, NONBASETHRDENA = 1 << 9, 1  # CCR
SLEEPONEXIT = 1 << 1  # SCR
T_BIT, ALIGNED = 1 << 24, 1 << 9  # xPSR; in a stacked one bit 9 says that the stack was aligned
IT_BITS = 0x0600FC00

TO_HANDLER, TO_MAIN, TO_PROCESS = 0x1, 0x9, 0xD  # bits 3:0 of EXC_RETURN
NO_FP = 0x10

AWAKE, IN_WFI, IN_WFE = 0, 1, 2  # SLEEPING


@njit(cache=True)
def charge(S: State, cycles: int) -> None:
    """Let `cycles` pass, by every bound of the cycle model."""
    S[CYCLES] += cycles
    S[CYCLES_MIN] += cycles
    S[CYCLES_MAX] += cycles


@njit(cache=True)
def enter(S: State, exception: int) -> None:
    """Take `exception`: stack the context of what runs, and begin the handler."""
    settle_fp(S)
    lr = _push(S)
    if lr < 0:
        # The frame did not fit. A fault of the same entry comes first if it is the more urgent one.
        lr = -lr
        derived = faulting.fault(S, faults.STACKING, native.get_register(S, REG_SP))
        if S[ERROR]:
            return
        if preemption.priority(S, derived) < preemption.priority(S, exception):
            exception = derived
        else:
            preemption.pend(S, derived)
    begin(S, exception, lr)
    charge(S, S[ENTRY_CYCLES])


@njit(cache=True)
def begin(S: State, exception: int, lr: int) -> None:
    """The handler of `exception` begins with `lr`, its caller's frame being on the stack (ExceptionTaken)."""
    handler = faulting.vector(S, exception)
    if handler == faulting.NO_VECTOR:
        exception = faulting.fault(S, faults.VECTOR_TABLE, S[VTOR] + 4 * exception)
        handler = faulting.vector(S, exception)
        if handler == faulting.NO_VECTOR:
            S[ERROR] = faults.ENDED
        if S[ERROR]:
            return
    if faulting.is_dead_end(S, handler):
        faulting.end(S, faults.DEAD_END, exception)
        return
    preemption.activate(S, exception)
    _handler_mode(S, exception)
    native.set_register(S, REG_LR, lr)
    S[EVENT] = 1
    _go(S, handler & ~1, handler & 1)


@njit(cache=True)
def _go(S: State, address: int, thumb: int) -> None:
    S[PC] = S[NEXT] = address
    S[THUMB] = thumb


@njit(cache=True)
def _push(S: State) -> int:
    """Stack the context (PushStack); the EXC_RETURN value for the handler, negative if memory refused."""
    control = native.get_register(S, REG_CONTROL)
    # Unlike a mask register CONTROL can be read at any privilege.
    fp = control & FPCA and S[FPCCR] & ASPEN
    size = FP_FRAME if fp else BASIC_FRAME
    sp = native.get_register(S, REG_SP)
    align = 4 if sp & 4 and (fp or S[CCR] & STKALIGN) else 0
    sp -= size + align
    thread = S[ACTIVE_DEPTH] == 0
    xpsr = native.get_register(S, REG_XPSR) & ~(0x1FF | T_BIT) | nvic.current(S) | S[THUMB] << 24
    frame = memory.writable(S, sp, size)
    if frame:
        for k in range(4):
            native.poke(frame + 4 * k, native.get_register(S, REG_R0 + k))
        native.poke(frame + 16, native.get_register(S, REG_R12))
        native.poke(frame + 20, native.get_register(S, REG_LR))
        native.poke(frame + 24, S[PC])
        native.poke(frame + 28, xpsr & ~ALIGNED | (ALIGNED if align else 0))
    if frame and fp:
        # Lazy stacking would write these later, and the same: nothing changes them before their first use.
        for k in range(16):
            native.poke(frame + BASIC_FRAME + 4 * k, native.get_register(S, REG_S0 + k))
        native.poke(frame + BASIC_FRAME + 64, native.get_register(S, REG_FPSCR))
    native.set_register(S, REG_SP, sp)
    if fp:
        _defer_fp(S, sp, thread)
    lr = 0xFFFFFFE0 | (0 if fp else NO_FP)
    if not thread:
        lr |= TO_HANDLER
    else:
        lr |= TO_PROCESS if control & SPSEL else TO_MAIN
    return lr if frame else -lr


@njit(cache=True)
def _defer_fp(S: State, frame: int, thread: bool) -> None:
    """Pay for the FP registers now, or with LSPEN when the handler uses the FPU (B1.5.7)."""
    if not S[FPCCR] & LSPEN:
        charge(S, FP_CONTEXT_CYCLES)
        return
    S[FPCAR] = frame + BASIC_FRAME
    S[FPCCR] = S[FPCCR] & ~LSP_THREAD | LSPACT | (LSP_THREAD if thread else 0)


@njit(cache=True)
def settle_fp(S: State) -> bool:
    """If the FPU has been used since its context was left to be stacked: pay for that; whether it was."""
    if S[FPCCR] & LSPACT and native.get_register(S, REG_CONTROL) & FPCA:
        S[FPCCR] &= ~LSPACT
        charge(S, FP_CONTEXT_CYCLES)
        return True
    return False


@njit(cache=True)
def _handler_mode(S: State, exception: int) -> None:
    """Handler mode on the main stack, outside any IT block, without FP context."""
    control = native.get_register(S, REG_CONTROL)
    if S[ACTIVE_DEPTH] == 1 and control & (NPRIV | SPSEL):
        # The engine lets SPSEL be written in privileged thread mode alone, nPRIV in handler mode too.
        native.set_register(S, REG_IPSR, exception)
        native.set_register(S, REG_CONTROL, 0)
        native.set_register(S, REG_IPSR, 0)
        native.set_register(S, REG_CONTROL, 0)
    xpsr = native.get_register(S, REG_XPSR)
    native.set_register(S, REG_XPSR_ALL, xpsr & ~(0x1FF | IT_BITS) | exception | T_BIT)
    native.set_register(S, REG_CONTROL, control & NPRIV)
    if control & NPRIV:
        _rebuild(S, xpsr)


@njit(cache=True)
def _rebuild(S: State, xpsr: int) -> None:
    """Writing the flags makes the engine derive anew what it translates by, privilege among it."""
    native.set_register(S, REG_FLAGS, xpsr)


@njit(cache=True)
def _thread_mode(S: State, control: int, xpsr: int) -> None:
    """From a handler to thread mode with `control` and the flags of `xpsr`."""
    native.set_register(S, REG_CONTROL, 0)
    native.set_register(S, REG_XPSR_ALL, xpsr & ~0x1FF)
    native.set_register(S, REG_CONTROL, control)
    if control & NPRIV:
        _rebuild(S, xpsr)


@njit(cache=True)
def leave(S: State) -> None:
    """Exception return (B1.5.8) by the EXC_RETURN value in PC: unstack, or go on with the next handler."""
    settle_fp(S)
    lr = S[PC] | 1  # the engine cleared bit 0
    number, nested = nvic.current(S), S[ACTIVE_DEPTH]
    returned = preemption.deactivate(S, number)
    if number != NMI:
        native.set_register(S, REG_FAULTMASK, 0)
    to = lr & 0xF
    base = nested == 1 or S[CCR] & NONBASETHRDENA
    legal = (to == TO_HANDLER and nested > 1) or (to in (TO_MAIN, TO_PROCESS) and base)
    if not (returned and legal and lr | NO_FP | 0xF == 0xFFFFFFFF):
        _refuse(S, faults.INVALID_RETURN, lr, lr & 0x0FFFFFFF | 0xF0000000)
        return
    following = preemption.candidate(S)
    if following and preemption.admits(S, following, True):
        begin(S, following, lr)
        charge(S, S[TAIL_CYCLES])
        return
    _pop(S, lr)
    S[EVENT] = 1
    if S[ACTIVE_DEPTH] == 0 and S[SCR] & SLEEPONEXIT:
        S[SLEEPING] = IN_WFI


@njit(cache=True)
def _refuse(S: State, kind: int, address: int, lr: int) -> None:
    """A return that fails: its fault is taken on the frame that is there."""
    exception = faulting.fault(S, kind, address)
    if not S[ERROR]:
        begin(S, exception, lr)
        charge(S, S[TAIL_CYCLES])


@njit(cache=True)
def _pop(S: State, lr: int) -> None:
    """Unstack the context that `lr` describes (PopStack)."""
    fp = not lr & NO_FP
    size = FP_FRAME if fp else BASIC_FRAME
    register = REG_PSP if lr & 0xF == TO_PROCESS else REG_MSP
    sp = native.get_register(S, register)
    frame = memory.readable(S, sp, size)
    if frame == memory.NOWHERE:
        _refuse(S, faults.UNSTACKING, sp, lr)
        return
    xpsr = native.peek(frame + 28)
    if (xpsr & 0x1FF == 0) != (lr & 0xF != TO_HANDLER):
        _refuse(S, faults.INVALID_RETURN, lr, lr)
        return
    for k in range(4):
        native.set_register(S, REG_R0 + k, native.peek(frame + 4 * k))
    native.set_register(S, REG_R12, native.peek(frame + 16))
    native.set_register(S, REG_LR, native.peek(frame + 20))
    _go(S, native.peek(frame + 24) & 0xFFFFFFFE, xpsr >> 24 & 1)
    if fp:
        _restore_fp(S, frame + BASIC_FRAME)
    align = 4 if xpsr & ALIGNED and (fp or S[CCR] & STKALIGN) else 0
    native.set_register(S, register, sp + size + align)
    # The engine takes a step in ARM state for an invalid instruction: THUMB holds the T bit.
    xpsr = xpsr & ~ALIGNED | T_BIT
    active = FPCA if fp else 0
    npriv = native.get_register(S, REG_CONTROL) & NPRIV
    if lr & 0xF == TO_HANDLER:
        native.set_register(S, REG_XPSR_ALL, xpsr)
        native.set_register(S, REG_CONTROL, npriv | active)
    else:
        _thread_mode(S, npriv | active | (SPSEL if lr & 0xF == TO_PROCESS else 0), xpsr)
    charge(S, S[EXIT_CYCLES])


@njit(cache=True)
def _restore_fp(S: State, saved: int) -> None:
    """With the context still waiting to be stacked the registers hold it themselves."""
    if S[FPCCR] & LSPACT:
        S[FPCCR] &= ~LSPACT
        return
    for k in range(16):
        native.set_register(S, REG_S0 + k, native.peek(saved + 4 * k))
    native.set_register(S, REG_FPSCR, native.peek(saved + 64))
    charge(S, FP_CONTEXT_CYCLES)
