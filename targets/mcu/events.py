"""What devices have to do at an instant of their own: the earliest one bounds how far the core runs.

A device with time in it has `due(S)`, CPU cycles of its next event or NEVER, and `service(S)`, which does
what has fallen due by CYCLES. The run loop calls both; between them no device needs to be looked at.
"""

from targets.jit import njit
from targets.mcu import bxcan
from targets.mcu.clock import cycles_at
from targets.mcu.state import State

NEVER = 1 << 62


@njit(cache=True)
def due(S: State) -> int:
    """CPU cycles at which the next device event falls due, NEVER if there is none."""
    can_ns = bxcan.due_ns(S)
    return NEVER if can_ns == bxcan.NEVER else cycles_at(S, can_ns)


@njit(cache=True)
def service(S: State) -> None:
    """Do what has fallen due."""
    bxcan.service(S)
