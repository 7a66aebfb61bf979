"""Alive counters: what they say of frames that never came, and of frames that came twice.

A counter goes up by one with every frame of its message and wraps where its bits end. Belongs here: the
counting. Never: why a frame is missing.
"""

import numpy as np
from numpy.typing import NDArray

SILENCE_NS = 500_000_000
"""After so long without a frame the sender has paused or was started again: its counter begins anew."""


class AliveCounter:
    """The alive counter of one message.

    lost: frames that must have been sent and were not heard; of a gap longer than the counter's range only
    the remainder shows. repeats: frames with the count of the one before. restarts: silences of SILENCE_NS.
    """

    def __init__(self, bits: int) -> None:
        self._range = 1 << bits
        self._count: int | None = None
        self._t_ns = 0
        self.lost = self.repeats = self.restarts = 0

    def feed(self, t_ns: NDArray[np.int64], counts: NDArray[np.int64]) -> None:
        """The counts (frames,) of frames heard at `t_ns` (frames,), in order, after those fed before."""
        if not len(counts):
            return
        if self._count is None:
            self._count, self._t_ns = int(counts[0]), int(t_ns[0])
            t_ns, counts = t_ns[1:], counts[1:]
        skipped = (np.diff(counts, prepend=self._count) - 1) % self._range
        silent = np.diff(t_ns, prepend=self._t_ns) >= SILENCE_NS
        repeated = (skipped == self._range - 1) & ~silent
        self.restarts += int(silent.sum())
        self.repeats += int(repeated.sum())
        self.lost += int(skipped[~silent & ~repeated].sum())
        if len(counts):
            self._count, self._t_ns = int(counts[-1]), int(t_ns[-1])
