"""The `bench` fixture: a lap that a test rides on as far as it wants, in virtual or in wall time.

Belongs here: how far to ride, and what has happened so far. Never: which bus or ECU it is (assembly).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from bench.bus.bits import frame_bits
from bench.errors import LapError
from bench.live import LiveRig, Replay
from bench.pytest_plugin.expect import Unmet, instants, seconds
from bench.pytest_plugin.handles import Faults
from bench.pytest_plugin.signals import Bus
from bench.pytest_plugin.under_test import EcuUnderTest
from bench.rig import Rig
from bench.verdict import Verdict, judge

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from bench.laps.lap import Lap
    from bench.panel import Panel
    from bench.pytest_plugin.assembly import Fitted
    from bench.recorder import Row
    from bench.script import Script
    from bench.watch import Watch


class Bench:
    """A lap under way. Times are seconds of bench time, from 0 at the lap's start.

    lap: what is ridden. ecu, bus, faults: as the fixtures of these names. rig, script, watch: the parts the
    bench is made of, for tests that look deeper. live: rides in wall time.
    """

    def __init__(
        self,
        lap: Lap,
        script: Script,
        watch: Watch,
        rig: Rig | LiveRig,
        panel: Panel,
        fitted: Fitted,
        bitrate: int,
        executor: Executor | None = None,
    ) -> None:
        self.lap, self.script, self.watch, self.rig, self.bitrate = lap, script, watch, rig, bitrate
        self.live = isinstance(rig, LiveRig)
        self.bus = Bus(self)
        self.ecu = EcuUnderTest(self, fitted)
        self.faults = Faults(self, panel, executor)
        self._verdict: Verdict | None = None

    @property
    def now(self) -> float:
        """Bench time, s."""
        return self.now_ns / 1e9

    @property
    def now_ns(self) -> int:
        """Bench time, ns."""
        return self.rig.now_ns

    @property
    def end(self) -> float:
        """When the lap ends, s."""
        return self.rig.end_ns / 1e9

    def ride(self, seconds: float) -> None:
        """Ride on for so long. Fails the test if the ride fails, raises LapError if the lap ends before."""
        __tracebackhide__ = True
        self._ride_to(self.now_ns + round(seconds * 1e9))

    def ride_to(self, t_s: float) -> None:
        """Ride on to that instant; see `ride`."""
        __tracebackhide__ = True
        self._ride_to(round(t_s * 1e9))

    def ride_until(self, happened: Callable[[], bool], deadline_ns: int) -> bool:
        """Ride on, cycle by cycle, until that is so or to the deadline, ns; whether it came to be.

        The lap's end is a deadline, too. Fails the test if the ride fails.
        """
        __tracebackhide__ = True
        last_ns = min(deadline_ns, self.rig.end_ns)
        while not happened():
            self._check()
            if self.now_ns >= last_ns or self._verdict:
                return False
            self.rig.advance(min(self.now_ns + self.script.cycle_ns, last_ns))
        return True

    def finish(self) -> Verdict:
        """Ride on to the lap's end and judge; a ride that fails is INVALID, and no failure of the test."""
        if self._verdict is None:
            self.rig.finish()
            self._verdict = self.verdict
        return self._verdict

    @property
    def verdict(self) -> Verdict:
        """Of the lap as far as it has been ridden: faults that are yet to come are left out."""
        now_ns = self.now_ns
        done = [i for i in self.script.now.insertions if i.t_cmd_ns <= now_ns]
        return self._verdict or judge(self.watch, done, self.failure)

    @property
    def failure(self) -> str | None:
        """Why the ride proves nothing, None if it may."""
        replay = self.replay
        return replay.failure if replay else self.rig.failure

    @property
    def replay(self) -> Replay | None:
        """How punctual the bench was on a live bus, None in virtual time."""
        return self.rig.replayed() if isinstance(self.rig, LiveRig) else None

    @property
    def rows(self) -> list[Row]:
        """Every frame so far, in order: when it ended (live: was sent or arrived), the frame, who sent it."""
        if isinstance(self.rig, LiveRig):
            return self.rig.replayed().frames
        return [(done.t_end_ns, done.frame, done.node) for done in self.rig.frames]

    @property
    def load(self) -> float:
        """Of the bus, 0 to 1; live: of the frames seen, without intermissions."""
        if isinstance(self.rig, Rig):
            return self.rig.ridden().load.load
        bits = sum(frame_bits(*frame) for _, frame, _ in self.rig.frames)
        return bits / self.bitrate / (self.now_ns / 1e9 / self.rig.speed) if self.rig.frames else 0.0

    @property
    def error_frames(self) -> int:
        """How many frames failed on the timed bus; a live one keeps them to itself."""
        return self.rig.ridden().load.error_frames if isinstance(self.rig, Rig) else 0

    def _ride_to(self, t_ns: int) -> None:
        __tracebackhide__ = True
        if self._verdict:
            raise LapError(f"ride to {seconds(t_ns)}: this lap is finished")
        if t_ns < self.now_ns:
            raise LapError(f"ride to {seconds(t_ns)}: bench time is {seconds(self.now_ns)} already")
        if t_ns > self.rig.end_ns:
            raise LapError(f"ride to {seconds(t_ns)}: the lap ends at {seconds(self.rig.end_ns)}")
        self.rig.advance(t_ns)
        self._check()

    def _check(self) -> None:
        __tracebackhide__ = True
        if self.rig.failure:
            raise Unmet("the ride to go on", self.failure or self.rig.failure, instants(self.verdict))
