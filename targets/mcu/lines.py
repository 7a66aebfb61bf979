"""Which device holds which interrupt line of the NVIC up (RM0090 table 61)."""

from targets.jit import njit
from targets.mcu import bxcan
from targets.mcu.state import State


@njit(cache=True)
def level(S: State, irq: int) -> bool:
    """Whether a device holds the line of `irq` up."""
    if bxcan.is_mine(irq):
        return bxcan.line(S, irq)
    return False
