"""The two ends of a live bus in wall time: the logger replaying a lap, and an ECU answering it.

The same parts as in virtual time, driven by the clock: the replay reports its own lateness, and a run that
was late by a period or more is no verdict on the ECU.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass

from bench.bus.live import LiveBus
from bench.mdlog.logger import Schedule
from bench.watch import Watch
from targets.ecu import Ecu, Frame

PERIOD_NS = 10_000_000
DRAIN_NS = 2 * PERIOD_NS
IDLE_S = 0.005

Row = tuple[int, Frame, str]


@dataclass(frozen=True)
class Replay:
    """What a live replay did: frames in the order sent and heard, worst and mean lateness of a cycle, ns."""

    frames: list[Row]
    worst_late_ns: int
    mean_late_ns: float
    failure: str | None


def replay(
    schedule: Schedule,
    bus: LiveBus,
    watch: Watch | None,
    progress: Callable[[int], None] | None = None,
    clock: Callable[[], int] = time.monotonic_ns,
) -> Replay:
    """Send the frames of `schedule` when they are due, and listen in between.

    watch: follows the ECU's answers, None where none is expected; an ECU that stops answering ends the
    replay. Heard frames are stamped with the instant they were read.
    """
    frames: list[Row] = []
    late: list[int] = []
    failure = None
    start = clock()

    def listen(until_ns: int) -> None:
        while (left := until_ns - (clock() - start)) > 0:
            frame = bus.receive(min(left / 1e9, 0.5))
            if frame is not None:
                t_ns = clock() - start
                frames.append((t_ns, frame, watch.role if watch else "heard"))
                if watch:
                    watch.heard(frame, t_ns)

    cycle, told = -1, 0
    for row, (t_ns, frame) in enumerate(schedule):
        if int(schedule.cycle[row]) != cycle:
            cycle = int(schedule.cycle[row])
            listen(t_ns)
            now = clock() - start
            late.append(now - t_ns)
            if watch and (failure := watch.cycle(now)):
                break
            if progress and t_ns - told >= 1_000_000_000:
                told = t_ns
                progress(t_ns)
        bus.send(frame)
        frames.append((clock() - start, frame, "MDLOG"))
    if not failure:
        listen(clock() - start + DRAIN_NS)
        failure = watch.unanswered(clock() - start) if watch else None
    worst = max(late, default=0)
    if worst >= PERIOD_NS:
        # Said first: an answer that seems to be missing may be the bench's own lateness.
        failure = f"the replay was late by {worst / 1e6:.1f} ms, a period is {PERIOD_NS / 1e6:.0f} ms"
    return Replay(frames, worst, sum(late) / len(late) if late else 0.0, failure)


def serve(
    ecu: Ecu,
    bus: LiveBus,
    clock: Callable[[], int] = time.monotonic_ns,
    seconds: float | None = None,
    ready: Callable[[], None] | None = None,
) -> int:
    """Let `ecu` live on `bus` until interrupted, or for `seconds`; the frames it sent.

    Its virtual time follows the clock. A frame it asks to send leaves as soon as its virtual time has come.
    """
    start = clock()
    sent = 0

    def catch_up(t_ns: int) -> int:
        count = 0
        while (request := ecu.advance(t_ns)) is not None:
            bus.send(request.frame)
            ecu.sent(request.handle, max(request.t_ns, t_ns))
            count += 1
        return count

    sent += catch_up(0)
    if ready:
        ready()
    while seconds is None or clock() - start < seconds * 1e9:
        frame = bus.receive(IDLE_S)
        t_ns = clock() - start
        sent += catch_up(t_ns)
        if frame is not None:
            ecu.receive(frame, t_ns)
            # What it does with the frame takes virtual time: look a millisecond ahead, do not wait for it.
            sent += catch_up(t_ns + 1_000_000)
    return sent
