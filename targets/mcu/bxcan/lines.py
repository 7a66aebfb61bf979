"""bxCAN's four interrupt lines a controller (RM0090 section 32.8, figure 348, and table 61)."""

from targets.jit import njit
from targets.mcu.bxcan.registers import (
    ERRI,
    ERRIE,
    FFIE0,
    FMPIE0,
    FOVIE0,
    FOVR,
    FULL,
    RQCP,
    SLAKI,
    SLKIE,
    TMEIE,
    WKUI,
    WKUIE,
)
from targets.mcu.state import (
    CAN_FIFO_COUNT,
    CAN_FIFO_FLAGS,
    CAN_IER,
    CAN_MSR,
    CAN_STRIDE,
    CAN_TSR,
    State,
)

TX_IRQ, RX0_IRQ, RX1_IRQ, SCE_IRQ = 19, 20, 21, 22
TX2_IRQ, SCE2_IRQ = 63, 66
_COMPLETED = RQCP | RQCP << 8 | RQCP << 16


@njit(cache=True)
def is_mine(irq: int) -> bool:
    """Whether `irq` is a line of CAN1 or CAN2."""
    return TX_IRQ <= irq <= SCE_IRQ or TX2_IRQ <= irq <= SCE2_IRQ


@njit(cache=True)
def line(S: State, irq: int) -> bool:
    """Level of an interrupt line."""
    c, kind = (0, irq - TX_IRQ) if irq <= SCE_IRQ else (CAN_STRIDE, irq - TX2_IRQ)
    ier = S[CAN_IER + c]
    if kind == 0:
        return ier & TMEIE != 0 and S[CAN_TSR + c] & _COMPLETED != 0
    if kind == 3:
        msr = S[CAN_MSR + c]
        return bool(
            (ier & ERRIE and msr & ERRI) or (ier & WKUIE and msr & WKUI) or (ier & SLKIE and msr & SLAKI)
        )
    fifo = kind - 1
    flags, enabled = S[CAN_FIFO_FLAGS + c + fifo], ier >> (3 * fifo)
    return bool(
        (enabled & FMPIE0 and S[CAN_FIFO_COUNT + c + fifo] > 0)
        or (enabled & FFIE0 and flags & FULL)
        or (enabled & FOVIE0 and flags & FOVR)
    )
