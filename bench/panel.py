"""The fault panel of a replay that is running: faults armed, fired and cleared, each with its instant.

Belongs here: the states of a fault, and handing changed plans to the script. Never: who pushes the buttons
(keyboard, socket, MAVLink), a clock, what a fault does.
"""

from collections.abc import Callable
from concurrent.futures import Executor, Future
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import partial
from typing import Any, NamedTuple

from bench.errors import FaultError
from bench.faults.insertion import Insertion, refuse_trigger
from bench.faults.spec import FaultSpec
from bench.script import Plan, Script

LEAD_NS = 50_000_000
"""How far ahead of the present a fault is commanded where planning the changed lap takes time of its own."""


class State(StrEnum):
    """Of a fault on the panel.

    ARMED: known, not commanded. FIRED: commanded, no sample differs yet. ACTIVE: it has acted and lasts.
    CLEARED: it has acted and ended. SPENT: it ended without having changed a sample.
    """

    ARMED = "armed"
    FIRED = "fired"
    ACTIVE = "active"
    CLEARED = "cleared"
    SPENT = "spent"


class Entry(NamedTuple):
    """One fault of the panel at an instant; insertion: its instants, None until it is part of the plan."""

    number: int
    spec: FaultSpec
    state: State
    insertion: Insertion | None


@dataclass
class _Fault:
    spec: FaultSpec
    place: int | None = None  # among the script's faults, once it is one of them
    asked: str | None = None  # "fire" or "clear", until a plan with it is followed
    cleared: bool = False  # its end has been commanded, and is not put off by asking again


class Panel:
    """The faults of `script`: those planned beforehand first, then those armed, numbered from 0.

    executor: plans a changed lap beside the replay, and what is fired or cleared acts at least LEAD_NS after
    the request; None: at once and in place, as virtual time allows. `settle` is to be called once a cycle.
    """

    def __init__(self, script: Script, executor: Executor | None = None) -> None:
        self._script = script
        self._executor = executor or _InPlace()
        self._lead_ns = LEAD_NS if executor else 0
        self._faults = [_Fault(spec, place) for place, spec in enumerate(script.now.specs)]
        self._planning: tuple[Future[Plan], int, dict[int, tuple[int, FaultSpec]]] | None = None

    def arm(self, spec: FaultSpec) -> int:
        """Put `spec` on the panel without a command; its number. It gets its time when it is fired.

        Raises FaultError for a fault this lap cannot have.
        """
        refuse_trigger(spec)
        if spec.on_bus:
            if lacking := self._script.now.frames.unsent.get(spec.sensor):
                raise FaultError(f"{spec}: nothing is sent: the lap lacks {', '.join(lacking)}")
        elif not self._script.healthy.codes.keys() >= {*spec.sensors}:
            raise FaultError(f"{spec}: the lap's sensors are {', '.join(self._script.healthy.codes)}")
        self._faults.append(_Fault(spec))
        return len(self._faults) - 1

    def fire(self, number: int, t_ns: int) -> None:
        """Command the armed fault `number` at bench time `t_ns`.

        Raises FaultError for a number that is not armed.
        """
        fault = self._of(number)
        if fault.place is not None or fault.asked:
            raise FaultError(f"fault {number} ({fault.spec}) has been fired already")
        self._ask(fault, "fire", t_ns)

    def clear(self, number: int, t_ns: int) -> None:
        """End fault `number` at bench time `t_ns`.

        Raises FaultError for one that is not fired, or has ended.
        """
        fault = self._of(number)
        if number not in self.clearable(t_ns):
            changing = fault.asked or fault.cleared
            state = "being changed" if changing else self.entries(t_ns)[number].state
            raise FaultError(f"fault {number} ({fault.spec}) is {state}: nothing to clear")
        self._ask(fault, "clear", t_ns)

    def clearable(self, t_ns: int) -> list[int]:
        """The numbers that `clear` takes at bench time `t_ns`."""
        rows = zip(self.entries(t_ns), self._faults, strict=True)
        return [
            entry.number
            for entry, fault in rows
            if entry.state in (State.FIRED, State.ACTIVE)
            and fault.place is not None
            and not fault.asked
            and not fault.cleared
        ]

    def settle(self, t_ns: int) -> None:
        """Begin to plan what has been asked for, hand a finished plan to the script."""
        if self._planning and self._planning[0].done():
            future, since_ns, changed = self._planning
            self._planning = None
            error = future.exception()
            if isinstance(error, FaultError):
                # The lap ended while it was planned: the request comes to nothing.
                for number in changed:
                    self._faults[number].asked = None
                if isinstance(self._executor, _InPlace):
                    raise error
            elif self._script.follow(future.result(), since_ns):
                for number, (place, spec) in changed.items():
                    self._faults[number] = _Fault(spec, place, cleared=self._faults[number].asked == "clear")
            # else planned too late: what is still asked for is planned again, for a later instant
        if not self._planning and any(fault.asked for fault in self._faults):
            self._plan(self._from(t_ns))

    def entries(self, t_ns: int) -> list[Entry]:
        """Every fault of the panel as it is at bench time `t_ns`."""
        return [Entry(n, fault.spec, *self._state(fault, t_ns)) for n, fault in enumerate(self._faults)]

    def _of(self, number: int) -> _Fault:
        if not 0 <= number < len(self._faults):
            known = f"0 to {len(self._faults) - 1}" if self._faults else "none"
            raise FaultError(f"no fault {number} on the panel; there are {known}")
        return self._faults[number]

    def _ask(self, fault: _Fault, what: str, t_ns: int) -> None:
        lap_ns = int(self._script.healthy.t_ns[-1])
        if self._from(t_ns) > lap_ns:
            raise FaultError(f"{fault.spec}: too late to {what} it: the lap ends at {lap_ns / 1e9:.9g} s")
        fault.asked = what
        self.settle(t_ns)
        if isinstance(self._executor, _InPlace):
            self.settle(t_ns)  # what has been begun is done

    def _from(self, t_ns: int) -> int:
        return max(t_ns + self._lead_ns, self._script.taken_ns + 1)

    def _plan(self, at_ns: int) -> None:
        specs = list(self._script.now.specs)
        changed = {}
        for number, fault in enumerate(self._faults):
            if fault.asked:
                place, spec = len(specs) if fault.place is None else fault.place, _changed(fault, at_ns)
                specs[place : place + 1] = [spec]
                changed[number] = place, spec
        self._planning = self._executor.submit(partial(self._script.plan, specs)), at_ns, changed

    def _state(self, fault: _Fault, t_ns: int) -> tuple[State, Insertion | None]:
        if fault.place is None:
            return (State.FIRED if fault.asked else State.ARMED), None
        insertion = self._script.now.insertions[fault.place]
        acted = insertion.t_active_ns is not None and insertion.t_active_ns <= t_ns
        if insertion.t_end_ns is not None and insertion.t_end_ns <= t_ns:
            return (State.CLEARED if acted else State.SPENT), insertion
        return (State.ACTIVE if acted else State.FIRED), insertion


def _changed(fault: _Fault, at_ns: int) -> FaultSpec:
    if fault.asked == "fire":
        return replace(fault.spec, t_cmd_ns=at_ns)
    duration_ns = max(at_ns - fault.spec.t_cmd_ns, 1)
    if fault.spec.duration_ns is not None:  # it may end by itself before that
        duration_ns = min(duration_ns, fault.spec.duration_ns)
    return replace(fault.spec, duration_ns=duration_ns)


class _InPlace(Executor):
    """Runs what it is given before it returns."""

    def submit(self, work: Callable[..., Any], /, *args: Any, **kwargs: Any) -> "Future[Any]":
        future: Future[Any] = Future()
        try:
            future.set_result(work(*args, **kwargs))
        except FaultError as error:
            future.set_exception(error)
        return future
