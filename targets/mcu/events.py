"""What devices have to do at an instant of their own: the earliest one bounds how far the core runs.

A device with time in it has `due(S)`, CPU cycles of its next event or NEVER, and `service(S)`, which does
what has fallen due. The run loop calls both; between them no device needs to be looked at. After `service`,
`due` lies in the future, or a sleeping core would wait for ever, unless a reset is asked for.
"""

from targets.jit import njit
from targets.mcu import bxcan, iwdg, rcc, systick, tim, usart, wwdg
from targets.mcu.clock import cycles_at
from targets.mcu.state import CYCLES, RESET_REQUEST, State

NEVER = rcc.NEVER


@njit(cache=True)
def due(S: State) -> int:
    """CPU cycles at which the next device event falls due, NEVER if there is none."""
    if S[RESET_REQUEST]:  # a core that sleeps must not sleep on
        return S[CYCLES]
    at = min(systick.due(S), rcc.due(S))
    at = min(at, iwdg.due(S))
    at = min(at, wwdg.due(S))
    at = min(at, tim.due(S))
    at = min(at, usart.due(S))
    can_ns = bxcan.due_ns(S)
    return at if can_ns == bxcan.NEVER else min(at, cycles_at(S, can_ns))


@njit(cache=True)
def service(S: State) -> None:
    """Do what has fallen due; what goes by CPU cycles before what may change their length."""
    systick.service(S)
    bxcan.service(S)
    tim.service(S)
    usart.service(S)
    wwdg.service(S)
    iwdg.service(S)
    rcc.service(S)
