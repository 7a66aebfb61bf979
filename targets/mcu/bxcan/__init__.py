"""bxCAN 1 and 2 (RM0090 section 32) at register level: one code for both, a file for each part of it.

A controller is told by its bus of frames that start and end, win, lose or fail (`node`), by the CPU of
register accesses (`access`), and does the rest at instants of its own (`course`). Functions over one
controller take `c`, the distance of its words from those of CAN1: 0 or CAN_STRIDE. What is tested:
docs/bxcan.md.
"""

from targets.mcu.bxcan.access import read, reset, write
from targets.mcu.bxcan.course import NEVER, due_ns, service
from targets.mcu.bxcan.lines import is_mine, line
from targets.mcu.bxcan.registers import BASE, SIZE

__all__ = ["BASE", "NEVER", "SIZE", "due_ns", "is_mine", "line", "read", "reset", "service", "write"]
