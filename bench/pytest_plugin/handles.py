"""The `faults` fixture: faults planned, fired and cleared by a test, each a handle on its instants."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from functools import partial
from typing import TYPE_CHECKING

from bench.control import parse_command
from bench.errors import FaultError
from bench.faults.spec import FaultSpec, parse_fault
from bench.panel import LEAD_NS, Entry, Panel, State
from bench.pytest_plugin.expect import seconds

if TYPE_CHECKING:
    from bench.pytest_plugin.ride import Bench


class Fault:
    """One fault of the lap. Its instants are seconds of bench time, None for what does not happen."""

    def __init__(self, faults: Faults, number: int) -> None:
        self._faults, self.number = faults, number

    def __repr__(self) -> str:
        return f"<Fault {self.spec} {self.state}>"

    @property
    def spec(self) -> FaultSpec:
        """The fault as it is written, with the time it got."""
        return self._entry.spec

    @property
    def state(self) -> State:
        """What has become of it by now: fired, active, cleared or spent."""
        return self._entry.state

    @property
    def t_cmd(self) -> float:
        """When it was commanded."""
        return self.spec.t_cmd_ns / 1e9

    @property
    def t_active(self) -> float | None:
        """The first sample that differs from the lap without it."""
        insertion = self._entry.insertion
        return _s(insertion.t_active_ns) if insertion else None

    @property
    def t_obs(self) -> float | None:
        """The first sample that differs by more than the sensor's tolerance."""
        insertion = self._entry.insertion
        return _s(insertion.t_obs_ns) if insertion else None

    @property
    def t_end(self) -> float | None:
        """When it ceases to act."""
        insertion = self._entry.insertion
        return _s(insertion.t_end_ns) if insertion else None

    def clear(self) -> None:
        """End it now. Raises FaultError for one that has ended."""
        self._faults.clear(self)

    @property
    def _entry(self) -> Entry:
        return self._faults.entries()[self.number]


class Faults:
    """The faults of a lap under way.

    On a live bus a changed lap takes time to plan, and a fault is commanded LEAD_NS ahead: `fire` and `clear`
    ride on until what they ask for is so, `plan` until it is planned. In virtual time that is at once.
    """

    def __init__(self, bench: Bench, panel: Panel, executor: Executor | None = None) -> None:
        self._bench, self._panel, self._executor = bench, panel, executor

    def __iter__(self) -> Iterator[Fault]:
        return (Fault(self, entry.number) for entry in self.entries())

    def entries(self) -> list[Entry]:
        """The panel's rows at this instant."""
        return self._panel.entries(self._bench.now_ns)

    def fire(self, text: str) -> Fault:
        """Command the fault `SENSOR:KIND[:PARAM=VALUE,...][@now+DURATION]` now.

        Raises FaultError for one that cannot be.
        """
        now_ns, number = self._bench.now_ns, self._panel.arm(parse_command(text))
        self._change(number, lambda: self._panel.fire(number, now_ns))
        fault = Fault(self, number)
        self._reach(fault.spec.t_cmd_ns)
        return fault

    def plan(self, text: str) -> Fault:
        """Let the fault `SENSOR:KIND[:PARAM=VALUE,...]@TIME[+DURATION]` come, TIME s after the lap's start.

        Raises FaultError for one that cannot be, and for a time that is past.
        """
        spec, now_ns = parse_fault(text), self._bench.now_ns
        lead_ns = LEAD_NS if self._executor else 0
        earliest_ns = now_ns + (lead_ns if now_ns else 0)
        if spec.t_cmd_ns < earliest_ns:
            raise FaultError(f"{text}: too late to plan it: the earliest is {seconds(earliest_ns)}")
        number = self._panel.arm(spec)
        # The panel adds its lead to the instant it is given.
        self._change(number, lambda: self._panel.fire(number, spec.t_cmd_ns - lead_ns))
        fault = Fault(self, number)
        if fault.spec.t_cmd_ns > spec.t_cmd_ns + 1:  # 1: what was due at the present instant has been sent
            raise FaultError(f"{text}: planning took too long, it comes at {seconds(fault.spec.t_cmd_ns)}")
        return fault

    def clear(self, fault: Fault | None = None) -> None:
        """End that fault now; without one, all that are active or under way.

        Raises FaultError for one that has ended.
        """
        numbers = [fault.number] if fault else self._panel.clearable(self._bench.now_ns)
        for number in numbers:
            now_ns = self._bench.now_ns
            self._change(number, partial(self._panel.clear, number, now_ns))
        for number in numbers:
            insertion = self.entries()[number].insertion
            if insertion and insertion.t_end_ns is not None:
                self._reach(insertion.t_end_ns)

    def _change(self, number: int, ask: Callable[[], None]) -> None:
        """Ask for a change of fault `number`, and ride on until it is planned."""
        before = self.entries()[number].spec
        ask()
        if self._executor and not self._bench.now_ns:
            # Before the start there is no hurry: its one thread has planned when it comes to this.
            self._executor.submit(int).result()
            self._panel.settle(0)
        end_ns = self._bench.rig.end_ns
        if not self._bench.ride_until(lambda: self.entries()[number].spec is not before, end_ns):
            raise FaultError(f"{before}: the lap ended at {seconds(end_ns)}, before that was planned")

    def _reach(self, t_ns: int) -> None:
        if self._executor:
            self._bench.ride_until(lambda: self._bench.now_ns >= t_ns, t_ns)


def _s(t_ns: int | None) -> float | None:
    return None if t_ns is None else t_ns / 1e9
