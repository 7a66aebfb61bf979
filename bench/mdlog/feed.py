"""The logger's frames, taken one after the other as they fall due.

Belongs here: the row reached. Never: where the frames come from (logger), a clock, a bus.
"""

from bench.mdlog.logger import Schedule
from targets.ecu import Frame


class Feed:
    """The frames of a schedule, in its order. cycle_ns: the logger's cycle."""

    def __init__(self, frames: Schedule) -> None:
        self._taken, self._taken_ns = 0, -1
        self.cycle_ns = frames.cycle_ns
        self.go_on_with(frames)

    def go_on_with(self, frames: Schedule) -> None:
        """Take the rows after those taken already from `frames`, which begins as the schedule so far did."""
        self._last_ns = int(frames.t_ns[-1]) if len(frames) else 0
        self._rows = frames.rows(self._taken)
        self._cycles = frames.cycle
        self._next = next(self._rows, None)

    @property
    def next_cycle(self) -> int:
        """The logger's cycle of the next frame, -1 if there is none, or if another node sends it."""
        return int(self._cycles[self._taken]) if self._next else -1

    def excuses(self, t_ns: int) -> bool:
        """Whether the logger's cycle of `t_ns` may go without an answer."""
        return False

    @property
    def next_ns(self) -> int | None:
        """When the next frame is due, None after the last."""
        return self._next[0] if self._next else None

    @property
    def taken_ns(self) -> int:
        """When the last frame taken was due, -1 before the first."""
        return self._taken_ns

    @property
    def last_ns(self) -> int:
        """When the last of all frames is due, 0 if there is none."""
        return self._last_ns

    def take(self, t_ns: int) -> Frame | None:
        """The next of the frames that are due by `t_ns`, None if there is none."""
        if self._next is None or self._next[0] > t_ns:
            return None
        self._taken_ns, frame = self._next
        self._taken += 1
        self._next = next(self._rows, None)
        return frame
