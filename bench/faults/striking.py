"""What a bus fault is given, and what it gives back: frames of a schedule struck out, changed or added.

Belongs here: the two shapes, and rows of a schedule. Never: what a kind does, merging.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.codec import Codec
from bench.faults.kind import Params, stream
from bench.mdlog.logger import Schedule

Rows = NDArray[np.intp]


class Striking(NamedTuple):
    """A fault at work on a logger's schedule.

    rows: the frames it concerns, those of its place asked for at start_ns <= t < end_ns, in order. last_ns:
    when the logger sends its last frame; end_ns is at most just after it. place: a message's name, or "bus".
    """

    schedule: Schedule
    rows: Rows
    place: str
    start_ns: int
    end_ns: int
    last_ns: int
    params: Params
    codec: Codec

    def random(self, purpose: str) -> np.random.Generator:
        """Random numbers for `purpose`: nothing that comes after the command decides them."""
        return stream(self.params, self.start_ns, f"{self.place}:{purpose}")

    def drawn(self, purpose: str) -> Rows:
        """The rows that the parameter `rate`, a probability for each frame, picks."""
        return self.rows[self.random(purpose).random(len(self.rows)) < float(self.params["rate"])]


class Struck(NamedTuple):
    """What becomes of a schedule: rows `lost`; `payload` uint8 (frames, 8) in place of its own; rows `added`.

    None where a fault leaves that alone.
    """

    lost: Rows | None = None
    payload: NDArray[np.uint8] | None = None
    added: Schedule | None = None


def taken(plan: Schedule, rows: Rows) -> Schedule:
    """The schedule of those rows, in that order."""
    return Schedule(
        plan.t_ns[rows],
        plan.ids[rows],
        plan.extended[rows],
        plan.lengths[rows],
        plan.payload[rows],
        plan.cycle[rows],
        plan.cycle_ns,
        plan.unsent,
    )
