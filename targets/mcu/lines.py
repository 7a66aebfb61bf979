"""Which device holds which interrupt line of the NVIC up (RM0090 table 61)."""

from targets.jit import njit
from targets.mcu import bxcan, exti, rcc, tim, usart, wwdg
from targets.mcu.state import State


@njit(cache=True)
def level(S: State, irq: int) -> bool:
    """Whether a device holds the line of `irq` up."""
    if bxcan.is_mine(irq):
        return bxcan.line(S, irq)
    if irq in tim.IRQS:
        return tim.line(S, irq)
    if irq == wwdg.IRQ:
        return wwdg.line(S)
    if irq == rcc.IRQ:
        return rcc.line(S)
    unit = usart.index_of_irq(irq)
    return usart.line(S, unit) if unit >= 0 else exti.line(S, irq)
