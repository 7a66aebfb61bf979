"""The `ecu` fixture: the ECU under test, and what a test expects of its alarm and its step time.

Belongs here: expectations with deadlines in bench time. Never: where the ECU runs (assembly).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Self

import pytest

from bench.pytest_plugin.expect import Unmet, instants, seconds
from bench.watch import Alarm as Raised

if TYPE_CHECKING:
    from bench.pytest_plugin.assembly import Fitted
    from bench.pytest_plugin.handles import Fault
    from bench.pytest_plugin.ride import Bench


class Cleared:
    """The end of an alarm."""

    def __init__(self, alarm: Alarm) -> None:
        self._alarm = alarm

    def within(self, seconds: float) -> Alarm:
        """Ride on until the alarm is down, which it has to be within so long from now."""
        __tracebackhide__ = True
        return self._alarm.heals(seconds)


class Alarm:
    """The ECU's alarm, as its frames on the bus say it."""

    def __init__(self, bench: Bench) -> None:
        self._bench = bench

    @property
    def up(self) -> bool:
        """Whether it is raised at this instant."""
        raised = self._latest
        return raised is not None and raised.off_ns is None

    @property
    def kind(self) -> str | None:
        """The fault that the latest alarm named, None if it named none or there was none."""
        return self._latest.kind if self._latest else None

    @property
    def t(self) -> float | None:
        """When the latest alarm was raised, s of bench time; None if there was none."""
        return self._latest.on_ns / 1e9 if self._latest else None

    @property
    def cleared(self) -> Cleared:
        """Its end, of which `within` can be asked."""
        return Cleared(self)

    def within(self, seconds: float, of: Fault | None = None) -> Self:
        """Ride on until the alarm is raised, which it has to be within so long from now.

        of: count from when that fault began to act instead, as the time to detect does. An alarm that is up
        already when the time begins to count is none for this fault.
        """
        __tracebackhide__ = True
        begin_ns = self._bench.now_ns
        expected = f"alarm within {seconds:g} s"
        if of is not None:
            active_s = of.t_active
            if active_s is None:
                raise Unmet(expected, f"{of.spec} never acts: every sample is as without it", [])
            begin_ns = round(active_s * 1e9)
            expected += f" of {of.spec}"
        self._wait(begin_ns, begin_ns + round(seconds * 1e9), expected)
        return self

    def absent_for(self, seconds: float) -> bool:
        """Ride on for so long, in which no alarm may be up. True, so that it can be asserted."""
        __tracebackhide__ = True
        end_ns = self._bench.now_ns + round(seconds * 1e9)
        if not self.up:
            before = len(self._bench.watch.alarms)
            self._bench.ride_until(lambda: len(self._bench.watch.alarms) > before, end_ns)
            if len(self._bench.watch.alarms) == before:
                self._in_lap(f"no alarm for {seconds:g} s", end_ns)
                return True
        raise Unmet(f"no alarm for {seconds:g} s", self._seen(), instants(self._bench.verdict, end_ns))

    def heals(self, seconds: float) -> Self:
        """Ride on until no alarm is up, which has to be so within so long from now."""
        __tracebackhide__ = True
        deadline_ns = self._bench.now_ns + round(seconds * 1e9)
        self._bench.ride_until(lambda: not self.up, deadline_ns)
        latest, expected = self._latest, f"alarm cleared within {seconds:g} s"
        if latest is None:
            raise Unmet(expected, "no alarm at all", instants(self._bench.verdict, deadline_ns))
        if latest.off_ns is None or latest.off_ns > deadline_ns:
            if latest.off_ns is None:
                self._in_lap(expected, deadline_ns)
            raise Unmet(expected, self._seen(), instants(self._bench.verdict, deadline_ns))
        return self

    def _wait(self, begin_ns: int, deadline_ns: int, expected: str) -> None:
        __tracebackhide__ = True
        watch = self._bench.watch

        def after() -> list[Raised]:
            return [alarm for alarm in watch.alarms if alarm.off_ns is None or alarm.off_ns > begin_ns]

        self._bench.ride_until(lambda: bool(after()), deadline_ns)
        found = after()
        if found and begin_ns <= found[0].on_ns <= deadline_ns:
            return
        if not found:
            self._in_lap(expected, deadline_ns)
        raise Unmet(expected, self._seen(), instants(self._bench.verdict, deadline_ns))

    def _in_lap(self, expected: str, deadline_ns: int) -> None:
        """What did not happen by the lap's end proves nothing of a deadline after it."""
        __tracebackhide__ = True
        if deadline_ns > self._bench.rig.end_ns:
            marks = instants(self._bench.verdict, deadline_ns)
            raise Unmet(expected, f"the lap's end at {seconds(self._bench.rig.end_ns)} before that", marks)

    def _seen(self) -> str:
        """The latest alarm in words, or how close the residual came."""
        latest, watch = self._latest, self._bench.watch
        if latest:
            called = f", naming {latest.kind}" if latest.kind else ""
            end = "" if latest.off_ns is None else f", cleared at {seconds(latest.off_ns)}"
            return f"alarm at {seconds(latest.on_ns)}{called}{end}"
        if not watch.answers:
            return "no alarm, no answer of the ECU at all"
        return f"no alarm, residual {watch.answers[-1].residual_pct:g} % at {seconds(watch.answers[-1].t_ns)}"

    @property
    def _latest(self) -> Raised | None:
        alarms = self._bench.watch.alarms
        return alarms[-1] if alarms else None


class StepTime:
    """How long the ECU computed at each input cycle, by its own count of CPU cycles."""

    def __init__(self, bench: Bench, fitted: Fitted) -> None:
        self._bench, self._fitted = bench, fitted

    @property
    def worst(self) -> float | None:
        """The longest so far, s; None where it cannot be known: on the host, or without a step."""
        cycles, hz = self._bench.watch.step_cycles, self._fitted.hz
        return max(cycles) / hz if hz and cycles else None

    def below(self, limit_s: float) -> Self:
        """Every step so far took less. Skips the test where step times cannot be known."""
        __tracebackhide__ = True
        if not self._fitted.hz:
            pytest.skip(f"no step time: {self._fitted.why_no_clock}")
        worst, expected = self.worst, f"every step below {limit_s * 1e6:g} us"
        if worst is None:
            raise Unmet(expected, "no step so far", instants(self._bench.verdict))
        if worst >= limit_s:
            number = self._bench.watch.step_cycles.index(max(self._bench.watch.step_cycles))
            seen = f"{worst * 1e6:.1f} us in step {number}, at {self._fitted.hz / 1e6:g} MHz"
            raise Unmet(expected, seen, instants(self._bench.verdict))
        return self


class EcuUnderTest:
    """The ECU at the other end of the bus.

    alarm, step_time: what can be expected of it. build: its image and calibration, None for a real ECU.
    device: the ECU itself in virtual time, to look into and to tamper with; None on a live bus.
    """

    def __init__(self, bench: Bench, fitted: Fitted) -> None:
        self.alarm = Alarm(bench)
        self.step_time = StepTime(bench, fitted)
        self.role, self.build, self.device, self.fitted = fitted.role, fitted.build, fitted.device, fitted
