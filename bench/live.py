"""The logger's end of a live bus: a lap replayed in wall time, by absolute deadlines, and the answers heard.

The same parts as in virtual time, driven by the clock. Bench time runs `speed` times as fast as the wall's.
The replay reports its own lateness, and a run that was late by a period or more is no verdict on the ECU.
Frames count from when they arrived, not from when this process came to read them.
"""

import gc
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from bench.bus.live import Heard
from bench.codec import Codec
from bench.errors import BusError
from bench.mdlog.feed import Feed
from bench.mdlog.logger import NODE
from bench.watch import Watch
from targets.ecu import Frame

DRAIN_NS = 20_000_000
"""How long the answer to the last cycle is waited for."""

CONTROL_NS = 10_000_000
"""The control loop's period (section III.2): how late a frame or an answer may be, unless the user says so.
Where messages come more often, answers have as long, for no operating system keeps every millisecond."""

TICK_NS = 5_000_000
"""How often, at most, those who attend a replay are given a turn."""

RETRY_NS = 200_000
"""How long a frame that found the interface's queue full waits for its next try."""

PATIENCE_NS = 10_000_000
"""How long a frame is tried before it counts as unsent."""

Row = tuple[int, Frame, str]


class Bus(Protocol):
    """What this room asks of a live bus; `LiveBus` is one.

    echoes: it hears its own frames. refusal: why it took no frame last, "" if it cannot tell.
    """

    echoes: bool

    @property
    def refusal(self) -> str: ...  # noqa: D102  # above

    def send(self, frame: Frame, timeout_s: float = 0.0) -> bool:
        """Put `frame` on the bus; False if it was not taken within `timeout_s` because a queue is full."""

    def receive(self, timeout_s: float) -> Heard | None:
        """The next frame, None if none came within `timeout_s`."""


@dataclass(frozen=True)
class Replay:
    """What a live replay did: frames in the order sent and heard, and how late each one left, wall ns.

    late_ns: int64 (frames sent,). refused: how often the interface's queue was full. unsent: frames given up
    for that. failure: why the run proves nothing, None if it may. lost: the bus went away.
    """

    frames: list[Row]
    late_ns: NDArray[np.int64]
    refused: int
    unsent: int
    failure: str | None
    lost: BusError | None = None

    @property
    def worst_late_ns(self) -> int:
        """Of all frames, 0 without any."""
        return int(self.late_ns.max(initial=0))

    def worst_late_within(self, since_ns: int, until_ns: int) -> int:
        """Of the frames that left from `since_ns` to `until_ns`, bench time."""
        left_ns = np.array([t_ns for t_ns, _, node in self.frames if node == NODE], dtype=np.int64)
        late_ns = self.late_ns[(left_ns >= since_ns) & (left_ns <= until_ns)]
        return int(late_ns.max(initial=0))

    @property
    def mean_late_ns(self) -> float:
        """Of all frames, 0 without any."""
        return float(self.late_ns.mean()) if len(self.late_ns) else 0.0


class LiveRig:
    """The frames of `source` on a live bus, brought forward step by step; the counterpart of `rig.Rig`.

    watch: follows the ECU's answers, None where none is expected; an ECU that stops answering ends the
    replay. progress is called with the bench time reached, ns, about once a second of it. attend: called with
    the bench time after a cycle's frames have left, at most every TICK_NS; must not block. speed: bench time
    over wall time. late_limit_ns: a frame or an answer so late, or by a longer cycle, makes the run one that
    proves nothing. Time starts with the first step. now_ns: the instant reached.
    """

    def __init__(
        self,
        source: Feed,
        bus: Bus,
        watch: Watch | None,
        progress: Callable[[int], None] | None = None,
        clock: Callable[[], int] = time.monotonic_ns,
        attend: Sequence[Callable[[int], None]] = (),
        speed: float = 1.0,
        late_limit_ns: int = CONTROL_NS,
    ) -> None:
        self._source, self._bus, self._watch, self._progress = source, bus, watch, progress
        self._clock, self._attend, self.speed = clock, attend, speed
        self._started: int | None = None
        self._told_ns, self._ticked_ns = 0, -TICK_NS
        self._late: list[int] = []
        self._refused = self._unsent = 0
        self._begun_ns: int | None = None  # a cycle sent, whose predecessor has not been judged yet
        self._number = -1  # the last cycle begun
        self._own: deque[Frame] = deque(maxlen=64)
        self._limit_ns = max(late_limit_ns, source.cycle_ns)
        self._drain_ns = max(int(DRAIN_NS * max(speed, 1.0)), self._limit_ns)
        if watch:
            watch.patience_ns = self._limit_ns - source.cycle_ns
        codec = watch.codec if watch else Codec()
        self._logged = {m.id: m.name for m in codec.messages() if NODE in m.senders}
        self.frames: list[Row] = []
        self.failure: str | None = None
        self._lost: BusError | None = None

    @property
    def now_ns(self) -> int:
        """Bench time, 0 before the first step."""
        return 0 if self._started is None else int((self._clock() - self._started) * self.speed)

    @property
    def end_ns(self) -> int:
        """When the last answer should have been heard."""
        return self._source.last_ns + self._drain_ns

    def advance(self, until_ns: int) -> None:
        """Replay what is due by `until_ns` and listen until then, or to where the replay fails."""
        if self._started is None:
            self._started = self._clock()
        try:
            with _no_collection():
                while (
                    not self.failure and (due_ns := self._source.next_ns) is not None and due_ns <= until_ns
                ):
                    self._listen(due_ns)
                    if not self.failure:
                        self._cycle(due_ns)
                self._listen(until_ns)
        except BusError as error:
            self.failure, self._lost = self.failure or f"{error.side}: {error}", error

    def finish(self) -> None:
        """Go on to the end of the lap, and wait for the answer to its last cycle."""
        self.advance(self._source.last_ns)
        self.advance(max(self.now_ns, self._source.last_ns) + self._drain_ns)
        self._settle()
        if self._watch and not self.failure and not self._source.excuses(self._source.taken_ns):
            self.failure = self._watch.unanswered(self.now_ns)

    def replayed(self) -> Replay:
        """What has happened so far."""
        late = np.array(self._late, dtype=np.int64)
        failure, worst, limit_ns = self.failure, int(late.max(initial=0)), self._limit_ns / self.speed
        if worst >= limit_ns:
            # Said first: an answer that seems to be missing may be the bench's own lateness.
            failure = f"the replay was late by {worst / 1e6:.1f} ms, the limit is {limit_ns / 1e6:g} ms"
        if self._unsent:
            why = self._bus.refusal or "the interface's queue stayed full"
            failure = f"{self._unsent} frames were not sent: {why}"
        frames = sorted(self.frames, key=lambda row: row[0])
        return Replay(frames, late, self._refused, self._unsent, failure, self._lost)

    def _cycle(self, due_ns: int) -> None:
        # Nothing stands between the instant and the frames: judging and drawing wait until they are out.
        begun_ns = now_ns = self.now_ns
        number = self._source.next_cycle
        while (frame := self._source.take(due_ns)) is not None:
            now_ns = self._send(due_ns, frame, now_ns)
            number = max(number, self._source.next_cycle if self._source.next_ns == due_ns else -1)
        if number > self._number:
            self._settle()
            self._begun_ns, self._number = begun_ns, number
        if begun_ns - self._ticked_ns >= TICK_NS:
            self._ticked_ns = begun_ns
            for turn in self._attend:
                turn(begun_ns)
        if self._progress and due_ns - self._told_ns >= 1_000_000_000:
            self._told_ns = due_ns
            self._progress(due_ns)

    def _send(self, due_ns: int, frame: Frame, now_ns: int) -> int:
        """Hand `frame` to the bus, again and again while that has no room; when it was done."""
        begun_ns = now_ns
        while not self._bus.send(frame):
            self._refused += 1
            if self.failure or now_ns - begun_ns >= PATIENCE_NS * self.speed:
                self._unsent += 1
                self.failure = self.failure or "frames were not sent"
                return now_ns
            self._listen(self.now_ns + int(RETRY_NS * self.speed))
            now_ns = self.now_ns
        self._late.append(int((now_ns - due_ns) / self.speed))
        self._own.append(frame)
        sent_ns = self.now_ns
        self.frames.append((sent_ns, frame, NODE))
        return sent_ns

    def _listen(self, until_ns: int) -> None:
        """Read what comes until `until_ns`, or until an answer is found missing."""
        now_ns = self.now_ns
        while not self.failure and (left := until_ns - now_ns) > 0:
            heard = self._bus.receive(min(left / self.speed / 1e9, 0.5))
            now_ns = self.now_ns
            if heard is None:
                self._settle()
                continue
            if heard.frame.id in self._logged and not heard.frame.extended:
                self._logger(heard.frame)
                continue
            t_ns = max(now_ns - int(heard.age_ns * self.speed), 0)
            if self._begun_ns is not None and t_ns >= self._begun_ns:
                self._settle()
            self.frames.append((t_ns, heard.frame, self._watch.role if self._watch else "heard"))
            if self._watch:
                self._watch.heard(heard.frame, t_ns)

    def _logger(self, frame: Frame) -> None:
        """A frame that only a data logger sends: an echo of our own, or there is another one."""
        if self._bus.echoes and frame in self._own:
            self._own.remove(frame)
        else:
            self.failure = (
                f"another data logger is on the bus: {self._logged[frame.id]} with alive count and data "
                f"{frame.data.hex()} is none of ours"
            )

    def _settle(self) -> None:
        if self._begun_ns is not None and self._watch:
            failure = self._watch.cycle(self._begun_ns, self._number, self._source.excuses)
            self.failure = self.failure or failure
        self._begun_ns = None


@contextmanager
def _no_collection() -> Iterator[None]:
    """Keep the garbage collector from pausing the block: it would look through every frame heard so far."""
    collecting = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collecting:
            gc.enable()
