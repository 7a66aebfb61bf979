"""What went over a bus, and how much: frames delivered, frames that failed, load.

Belongs here: records and their sums. Never: who sends when.
"""

from collections import deque
from typing import NamedTuple

from targets.ecu import ErrorCode, Frame

EXTENDED = 0x8000_0000
"""Added to a 29-bit identifier where identifiers are keys, as SocketCAN does."""

ERRORS_KEPT = 1000


class Delivered(NamedTuple):
    """A frame that went over the bus: its start of frame, the end of its end of frame, and who sent it."""

    t_start_ns: int
    t_end_ns: int
    node: str
    handle: int
    frame: Frame
    bits: int


class ErrorFrame(NamedTuple):
    """A frame that failed: its start, when and as what it was seen, the end of the error delimiter."""

    t_start_ns: int
    t_error_ns: int
    t_end_ns: int
    node: str
    frame: Frame
    code: ErrorCode


class Traffic(NamedTuple):
    """What one identifier did: frames delivered, and the longest wait from submission to start of frame."""

    frames: int
    worst_wait_ns: int


class Load(NamedTuple):
    """What the bus did up to an instant; times in ns.

    bits: of the delivered frames, stuff bits included, intermissions not. busy_ns: sending, error frames and
    intermissions included. load: busy_ns over the elapsed time, 0 to 1. by_id: identifier (29 bits:
    + EXTENDED) -> Traffic. error_frames: how many frames failed.
    """

    bits: int
    busy_ns: int
    elapsed_ns: int
    load: float
    by_id: dict[int, Traffic]
    error_frames: int = 0


class Tally:
    """Sums over the frames started so far. latest_errors: the last frames that failed."""

    def __init__(self) -> None:
        self.latest_errors: deque[ErrorFrame] = deque(maxlen=ERRORS_KEPT)
        self._bits = 0
        self._busy_ns = 0
        self._error_frames = 0
        self._traffic: dict[int, list[int]] = {}

    def delivered(self, frame: Frame, bits: int, busy_ns: int, waited_ns: int) -> None:
        """A frame that will end well has started, `waited_ns` after it was asked for."""
        self._bits += bits
        self._busy_ns += busy_ns
        key = frame.id | EXTENDED if frame.extended else frame.id
        traffic = self._traffic.setdefault(key, [0, 0])
        traffic[0] += 1
        traffic[1] = max(traffic[1], waited_ns)

    def failed(self, error: ErrorFrame, busy_ns: int) -> None:
        """A frame that will fail has started."""
        self._busy_ns += busy_ns
        self._error_frames += 1
        self.latest_errors.append(error)

    def load(self, elapsed_ns: int) -> Load:
        """Statistics over `elapsed_ns` from t = 0."""
        by_id = {key: Traffic(frames, wait) for key, (frames, wait) in sorted(self._traffic.items())}
        share = self._busy_ns / elapsed_ns if elapsed_ns > 0 else 0.0
        return Load(self._bits, self._busy_ns, elapsed_ns, share, by_id, self._error_frames)
