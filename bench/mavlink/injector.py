"""Failure injection by command: what is asked of the fault panel, and how each command is answered.

A command of one who may not inject is DENIED, one that the bench cannot carry out UNSUPPORTED. Any other is
IN_PROGRESS when the panel has taken it, once a second as long as it lasts, and in the end ACCEPTED: the fault
has acted, or, to clear, all faults of the unit have ended. FAILED: it ended without having changed a sample,
or the lap is over.
Belongs here: the order of answers. Never: packets, addresses' rights, what a fault does.
"""

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any, NamedTuple

from bench.control import parse_command
from bench.errors import FaultError
from bench.mavlink.failures import Failure, failure
from bench.panel import LEAD_NS, Entry, Panel, State

INJECT = 420
"""MAV_CMD_INJECT_FAILURE."""

MOST_FAULTS = 256
"""On the panel; more are TEMPORARILY_REJECTED, for every changed lap is planned with all of them."""


class Result(IntEnum):
    """MAV_RESULT."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4
    IN_PROGRESS = 5


class Asker(NamedTuple):
    """Who sent a command: address, system and component."""

    address: Any
    system: int
    component: int


class Ack(NamedTuple):
    """An answer that is to be sent."""

    command: int
    result: Result
    to: Asker


@dataclass
class Injection:
    """A command that the panel has taken. numbers: its faults on the panel; t_ns: bench time of the command.

    told_ns: bench time of the last answer.
    """

    t_ns: int
    asker: Asker
    asked: Failure
    numbers: tuple[int, ...]
    told_ns: int
    result: Result = Result.IN_PROGRESS
    cleared: set[int] = field(default_factory=set)


class Injector:
    """Failure commands on `panel`. again_ns: bench time after which IN_PROGRESS is said again.

    taken: every command the panel has taken, in order. refused: the others, by result.
    """

    def __init__(self, panel: Panel, again_ns: int = 1_000_000_000) -> None:
        self._panel, self._again_ns = panel, again_ns
        self.taken: list[Injection] = []
        self.refused: Counter[Result] = Counter()

    def command(self, fields: Mapping[str, Any], asker: Asker, allowed: bool, t_ns: int) -> Ack:
        """The first answer to a MAV_CMD_INJECT_FAILURE that came at bench time `t_ns`."""
        result = self._result(fields, asker, t_ns) if allowed else Result.DENIED
        if result not in (Result.IN_PROGRESS, Result.ACCEPTED):
            self.refused[result] += 1
        return Ack(INJECT, result, asker)

    def turn(self, t_ns: int) -> list[Ack]:
        """The answers due at bench time `t_ns`."""
        under_way = self._under_way()
        if not under_way:
            return []
        acks = []
        for injection in under_way:
            entries = self._panel.entries(t_ns)
            injection.result = self._progress(injection, [entries[n] for n in injection.numbers], t_ns)
            if injection.result is not Result.IN_PROGRESS or t_ns - injection.told_ns >= self._again_ns:
                injection.told_ns = t_ns
                acks.append(Ack(INJECT, injection.result, injection.asker))
        return acks

    def end(self, t_ns: int) -> list[Ack]:
        """The last answers: the lap is over at `t_ns`."""
        acks = [ack for ack in self.turn(t_ns) if ack.result is not Result.IN_PROGRESS]
        for injection in self._under_way():
            injection.result = Result.FAILED
            acks.append(Ack(INJECT, Result.FAILED, injection.asker))
        return acks

    def _under_way(self) -> list[Injection]:
        return [one for one in self.taken if one.result is Result.IN_PROGRESS]

    def _result(self, fields: Mapping[str, Any], asker: Asker, t_ns: int) -> Result:
        asked = failure(fields)
        if asked is None:
            return Result.UNSUPPORTED
        before = next((one for one in reversed(self.taken) if one.asked == asked), None)
        # COMMAND_INT has no confirmation: while one is under way, the same again is a repetition of it
        if before and (before.result is Result.IN_PROGRESS or fields.get("confirmation")):
            before.asker = asker
            return before.result
        return self._clear(asked, asker, t_ns) if asked.kind is None else self._fire(asked, asker, t_ns)

    def _fire(self, asked: Failure, asker: Asker, t_ns: int) -> Result:
        if len(self._panel.entries(t_ns)) >= MOST_FAULTS:
            return Result.TEMPORARILY_REJECTED
        numbers = list(self._armed(asked))
        if not numbers:
            return Result.UNSUPPORTED
        try:
            for number in numbers:
                self._panel.fire(number, t_ns)
        except FaultError:  # the lap is all but over
            return Result.FAILED
        self.taken.append(Injection(t_ns, asker, asked, tuple(numbers), t_ns))
        return Result.IN_PROGRESS

    def _armed(self, asked: Failure) -> Iterable[int]:
        """The numbers of the faults that this lap's sensors, and these kinds, allow."""
        for sensor in asked.sensors:
            try:
                yield self._panel.arm(parse_command(f"{sensor}:{asked.kind}"))
            except FaultError:
                continue

    def _clear(self, asked: Failure, asker: Asker, t_ns: int) -> Result:
        numbers = tuple(entry.number for entry in self._panel.entries(t_ns) if _lasts(entry, asked, t_ns))
        if not numbers:
            return Result.ACCEPTED
        self.taken.append(Injection(t_ns, asker, asked, numbers, t_ns))
        return Result.IN_PROGRESS

    def _progress(self, injection: Injection, entries: list[Entry], t_ns: int) -> Result:
        states = {entry.state for entry in entries}
        if injection.asked.kind is not None:
            if State.SPENT in states:
                return Result.FAILED
            return Result.ACCEPTED if states <= {State.ACTIVE, State.CLEARED} else Result.IN_PROGRESS
        if states <= {State.CLEARED, State.SPENT}:
            return Result.ACCEPTED
        # each once: a fault that is being cleared is clearable until its end has come
        clearable = {*injection.numbers} & {*self._panel.clearable(t_ns)} - injection.cleared
        try:
            for number in sorted(clearable):
                self._panel.clear(number, t_ns)
                injection.cleared.add(number)
        except FaultError:
            return Result.FAILED
        return Result.IN_PROGRESS


def _lasts(entry: Entry, asked: Failure, t_ns: int) -> bool:
    """Whether the fault is one of the unit's that acts by now: one planned for later is not there yet."""
    begun = entry.insertion is None or entry.spec.t_cmd_ns <= t_ns + LEAD_NS
    return entry.spec.sensor in asked.sensors and begun and entry.state in (State.FIRED, State.ACTIVE)
