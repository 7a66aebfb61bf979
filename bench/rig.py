"""The rig in virtual time: logger, bus and ECU brought together, event by event.

Belongs here: who acts when. Never: what a frame says (watch), what it means (verdict), a file, a clock.
"""

from collections.abc import Callable
from dataclasses import dataclass

from bench.bus.timed import Delivered, Disturbance, Load, TimedBus
from bench.errors import BusError
from bench.mdlog.feed import Feed
from bench.mdlog.logger import NODE, Schedule
from bench.watch import Watch
from targets.ecu import Ecu
from targets.errors import FirmwareFault

DRAIN_NS = 20_000_000
"""Past the last logger cycle the bus is watched on for two periods, so that the last answer is heard."""

MOST_WAITING = 64
"""Frames an ECU may have waiting for the bus: no controller queues that many, a runaway program does."""


@dataclass(frozen=True)
class Ride:
    """What happened on the bus during one lap.

    frames: every frame that went over the bus, in order. load: the bus's statistics. end_ns: when the rig
    stopped. failure: why it stopped early, None if it did not.
    """

    frames: list[Delivered]
    load: Load
    end_ns: int
    failure: str | None = None


class Rig:
    """Logger, bus and ECU on one clock, brought forward step by step.

    source: what the logger sends. disturbance: breaks frames on the bus. watch sees every frame of the ECU.
    progress is called with the time reached, ns, about once a second of the lap. frames: every frame that
    went over the bus, in order. now_ns: the instant reached. An ECU that faults, stops answering, floods the
    bus or asks for what no bus carries ends the ride early: `failure` says why, and the rig moves no more.
    """

    def __init__(
        self,
        source: Feed,
        ecu: Ecu,
        watch: Watch,
        bitrate: int = 500_000,
        progress: Callable[[int], None] | None = None,
        disturbance: Disturbance | None = None,
    ) -> None:
        self._source, self._ecu, self._watch, self._progress = source, ecu, watch, progress
        self.bitrate = bitrate
        self._bus = TimedBus(bitrate, disturbance)
        self._bus.attach(ecu)
        self._handle, self._told_ns, self._cycle = 0, 0, -1
        self.frames: list[Delivered] = []
        self.now_ns = 0
        self.failure: str | None = None

    @property
    def end_ns(self) -> int:
        """When the last answer should have been heard."""
        return self._source.last_ns + DRAIN_NS

    def ridden(self) -> Ride:
        """What has happened so far."""
        return Ride(self.frames, self._bus.load(self.now_ns), self.now_ns, self.failure)

    def advance(self, until_ns: int) -> None:
        """Go on to `until_ns`, or to where the ride fails; what is due at that instant has been sent."""
        if self.failure:
            return
        try:
            self._fail(self._advance(until_ns))
        except (FirmwareFault, BusError) as fault:
            self._fail(f"{fault.side}: {fault}")

    def finish(self) -> None:
        """Go on to the end, and ask for the answer to the last cycle."""
        self.advance(self.end_ns)
        if not self.failure:
            failure = self._watch.unanswered(self.now_ns)
            self._fail(None if self._source.excuses(self._source.taken_ns) else failure)

    def _fail(self, failure: str | None) -> None:
        if failure and failure.startswith(Watch.OVERRUN):
            where = self._ecu.where()
            failure += f"; {where}" if where else ""
        self.failure = failure

    def _advance(self, until_ns: int) -> str | None:
        source, bus, ecu = self._source, self._bus, self._ecu
        while True:
            # The next instant at which anything outside the ECU happens; the ECU may ask for one before it.
            upcoming_ns = source.next_ns
            due_ns = until_ns if upcoming_ns is None or upcoming_ns > until_ns else upcoming_ns
            decision_ns = bus.next_decision_ns()
            now_ns = due_ns if decision_ns is None or decision_ns > due_ns else decision_ns
            self.now_ns = now_ns
            request = ecu.advance(now_ns)
            if request is not None:
                bus.submit(request.t_ns, ecu.name, request.handle, request.frame)
                waiting = bus.waiting(ecu.name)
                if waiting > MOST_WAITING:
                    return f"ECU floods the bus: {waiting} frames wait at {now_ns / 1e9:.9g} s"
                continue
            while source.next_ns == now_ns:  # what is due at one instant competes by priority
                failure = self._submit(now_ns)
                if failure:
                    return failure
            delivered = bus.step(now_ns)
            if delivered is not None:
                self._hear(delivered)
            elif now_ns >= until_ns:
                return None

    def _submit(self, now_ns: int) -> str | None:
        """The next frame goes to the bus; what was wrong with the cycle before the one it begins."""
        number, failure = self._source.next_cycle, None
        if number > self._cycle:
            self._cycle = number
            failure = self._watch.cycle(now_ns, number, self._source.excuses)
        frame = self._source.take(now_ns)
        if frame is not None and not failure:
            self._bus.submit(now_ns, NODE, self._handle, frame)
            self._handle += 1
        return failure

    def _hear(self, delivered: Delivered) -> None:
        self.frames.append(delivered)
        if delivered.node != NODE:
            self._watch.heard(delivered.frame, self.now_ns)
        if self._progress is not None and self.now_ns - self._told_ns >= 1_000_000_000:
            self._told_ns = self.now_ns
            self._progress(self.now_ns)


def ride(
    frames: Schedule,
    ecu: Ecu,
    watch: Watch,
    bitrate: int = 500_000,
    progress: Callable[[int], None] | None = None,
    disturbance: Disturbance | None = None,
) -> Ride:
    """Put all of `frames` on a timed bus with `ecu` until both are done; see `Rig`."""
    rig = Rig(Feed(frames), ecu, watch, bitrate, progress, disturbance)
    rig.finish()
    return rig.ridden()
