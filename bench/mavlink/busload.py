"""The bus's load while a replay runs, from the frames sent and heard so far."""

from collections.abc import Sequence
from itertools import islice

from bench.bus.bits import frame_bits
from targets.ecu import Frame

Row = tuple[int, Frame, str]


class BusLoad:
    """Of a bus of `bitrate` bit/s, without its intermissions and error frames.

    speed: bench time over the wall's. frames: the replay's, which grow.
    """

    def __init__(self, bitrate: int, speed: float = 1.0) -> None:
        self._bitrate, self._speed = bitrate, speed
        self._counted, self._since_ns = 0, 0
        self.frames: Sequence[Row] = ()

    def __call__(self, t_ns: int) -> float | None:
        """Since the call before, in %, at bench time `t_ns`; None if no time has passed."""
        lasted_s = (t_ns - self._since_ns) / 1e9 / self._speed
        if lasted_s <= 0:
            return None
        bits = sum(frame_bits(*frame) for _, frame, _ in islice(self.frames, self._counted, None))
        self._counted, self._since_ns = len(self.frames), t_ns
        return 100 * bits / self._bitrate / lasted_s
