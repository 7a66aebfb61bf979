"""The two ends of a live bus in wall time: the logger replaying a lap, and an ECU answering it.

The same parts as in virtual time, driven by the clock: the replay reports its own lateness, and a run that
was late by a period or more is no verdict on the ECU. Frames count from when they arrived, not from when this
process came to read them.
"""

import gc
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import groupby
from typing import Protocol

from bench.bus.live import Heard
from bench.codec import Codec
from bench.mdlog.logger import NODE, Schedule
from bench.watch import Watch
from targets.ecu import Ecu, Frame

PERIOD_NS = 10_000_000
DRAIN_NS = 2 * PERIOD_NS

IDLE_S = 0.005
"""How often the ECU's virtual time is brought up to the clock when no frame comes."""

LOOK_NS = 1_000_000
AHEAD_NS = 100_000_000
"""Virtual time given to the ECU at once with each frame, and how far that may put it ahead of the clock."""

Row = tuple[int, Frame, str]


class Bus(Protocol):
    """What this room asks of a live bus; `LiveBus` is one."""

    def send(self, frame: Frame) -> None:
        """Put `frame` on the bus."""

    def receive(self, timeout_s: float) -> Heard | None:
        """The next frame, None if none came within `timeout_s`."""


@dataclass(frozen=True)
class Replay:
    """What a live replay did: frames in the order sent and heard, worst and mean lateness of a cycle, ns."""

    frames: list[Row]
    worst_late_ns: int
    mean_late_ns: float
    failure: str | None


def replay(
    schedule: Schedule,
    bus: Bus,
    watch: Watch | None,
    progress: Callable[[int], None] | None = None,
    clock: Callable[[], int] = time.monotonic_ns,
) -> Replay:
    """Send the frames of `schedule` when they are due, and listen in between.

    watch: follows the ECU's answers, None where none is expected; an ECU that stops answering ends the
    replay. progress is called with the time reached, ns, about once a second.
    """
    with _no_collection():
        start = clock()
        listener = _Listener(bus, watch, lambda: clock() - start)
        late: list[int] = []
        told = 0
        for t_ns, group in groupby(schedule, key=lambda row: row[0]):
            listener.listen(t_ns)
            if listener.failure:
                break
            # Nothing stands between the instant and the frames: judging and drawing wait until they are out.
            now = clock() - start
            late.append(now - t_ns)
            for _, frame in group:
                bus.send(frame)
                listener.frames.append((clock() - start, frame, NODE))
            listener.cycle(now)
            if progress and t_ns - told >= 1_000_000_000:
                told = t_ns
                progress(t_ns)
        listener.finish(DRAIN_NS)
    failure, worst = listener.failure, max(late, default=0)
    if worst >= PERIOD_NS:
        # Said first: an answer that seems to be missing may be the bench's own lateness.
        failure = f"the replay was late by {worst / 1e6:.1f} ms, a period is {PERIOD_NS / 1e6:.0f} ms"
    listener.frames.sort(key=lambda row: row[0])
    return Replay(listener.frames, worst, sum(late) / len(late) if late else 0.0, failure)


class _Listener:
    """Hears the bus and judges each cycle, once all that arrived before the next one has been read."""

    def __init__(self, bus: Bus, watch: Watch | None, now: Callable[[], int]) -> None:
        self._bus, self._watch, self._now = bus, watch, now
        self.frames: list[Row] = []
        self.failure: str | None = None
        self._begun_ns: int | None = None  # a cycle sent, whose predecessor has not been judged yet

    def cycle(self, t_ns: int) -> None:
        """The next cycle's frames left at `t_ns`."""
        self._settle()
        self._begun_ns = t_ns

    def listen(self, until_ns: int) -> None:
        """Read what comes until `until_ns`, or until an answer is found missing."""
        while not self.failure and (left := until_ns - self._now()) > 0:
            heard = self._bus.receive(min(left / 1e9, 0.5))
            if heard is None:
                self._settle()
                continue
            t_ns = max(self._now() - heard.age_ns, 0)
            if self._begun_ns is not None and t_ns >= self._begun_ns:
                self._settle()
            self.frames.append((t_ns, heard.frame, self._watch.role if self._watch else "heard"))
            if self._watch:
                self._watch.heard(heard.frame, t_ns)

    def finish(self, drain_ns: int) -> None:
        """Wait for the answer to the last cycle, and judge it."""
        self.listen(self._now() + drain_ns)
        self._settle()
        if self._watch and not self.failure:
            self.failure = self._watch.unanswered(self._now())

    def _settle(self) -> None:
        if self._begun_ns is not None and self._watch:
            self.failure = self.failure or self._watch.cycle(self._begun_ns)
        self._begun_ns = None


def serve(
    ecu: Ecu,
    bus: Bus,
    clock: Callable[[], int] = time.monotonic_ns,
    seconds: float | None = None,
    ready: Callable[[], None] | None = None,
) -> int:
    """Let `ecu` live on `bus` until interrupted, or for `seconds`; the frames it sent.

    Its virtual time follows the clock, except that after each frame it is given LOOK_NS at once: what it does
    with the frame takes virtual time, and waiting for that would only add to the time it takes to emulate it.
    """
    sent = 0

    def catch_up(t_ns: int) -> int:
        count = 0
        while (request := ecu.advance(t_ns)) is not None:
            bus.send(request.frame)
            ecu.sent(request.handle, max(request.t_ns, t_ns))
            count += 1
        return count

    sent += catch_up(0)
    gc.freeze()  # what has been imported by now stays: no need to look through it again and again
    begun = clock()
    reached, arrived = 0, 0
    if ready:
        ready()
    while seconds is None or clock() - begun < seconds * 1e9:
        heard = bus.receive(IDLE_S)
        now = clock() - begun
        if heard is None:
            reached = max(reached, now)
            sent += catch_up(reached)
            continue
        # Frames read late, after a pause of this process, still come one after the other.
        arrived = max(arrived, now - heard.age_ns)
        reached = max(reached, arrived)
        sent += catch_up(reached)
        ecu.receive(heard.frame, arrived)
        # More frames than any bus carries may not push its time ever farther ahead.
        reached = max(reached, min(reached + LOOK_NS, now + AHEAD_NS))
        sent += catch_up(reached)
    return sent


def rehearse(ecu: Ecu) -> None:
    """Let a spare `ecu` answer one input cycle, so that all that is compiled at first use is compiled."""
    ecu.advance(0)
    for message in Codec().messages():
        if NODE in message.senders:
            ecu.receive(Frame(message.id, bytes(message.length), message.extended), 0)
    while (request := ecu.advance(PERIOD_NS)) is not None:
        ecu.sent(request.handle, request.t_ns)


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
