"""What the bench reads off the bus about the ECU: answers, alarms, step cycles. Sans-I/O, any bus.

Belongs here: the ECU's frames, decoded. Never: whether an alarm was right (verdict), who carries the frames.
"""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

from bench.codec import Codec
from targets.ecu import Frame
from targets.errors import TargetError

STATUS = {"ifd": "IFD_STATUS", "soft_sensor": "SOFT_STROKE"}
TIMING = {"ifd": "IFD_TIMING", "soft_sensor": "SOFT_TIMING"}
"""The DBC messages in which each role answers an input cycle, and says what the step cost."""


class Alarm(NamedTuple):
    """The alarm was up on the bus in [on_ns, off_ns), off_ns None while it lasts.

    kind: the fault it named when it was raised, None if it named none.
    """

    on_ns: int
    off_ns: int | None = None
    kind: str | None = None


class Answer(NamedTuple):
    """One status frame of the ECU that carries a prediction; residual_pct NaN where it has none."""

    t_ns: int
    predicted_mm: float
    residual_pct: float


@dataclass
class Watch:
    """Follows an ECU of `role` on the bus, one input cycle after the other.

    An answer echoes the cycle's alive count; a cycle not answered when the next one is due is an overrun, or
    when the first one after patience_ns is.
    alarms: every alarm, in order of time. answers: every status frame, in order of time.
    step_cycles: CPU cycles of every step. missed_inputs, overruns: the ECU's own counts, less what they were
    in its first answer: an ECU that has been running for long is not to blame for an earlier run.
    unanswered_cycles: of those that a fault of the bus excuses.
    garbled: what was wrong with the first frame of the ECU that could not be read.
    Raises TargetError for a role that does not exist.
    """

    codec: Codec
    role: str = "ifd"
    answered: int = 0
    alarms: list[Alarm] = field(default_factory=list)
    answers: list[Answer] = field(default_factory=list)
    step_cycles: list[int] = field(default_factory=list)
    missed_inputs: int = 0
    overruns: int = 0
    unanswered_cycles: int = 0
    cycles: int = 0
    garbled: str | None = None
    patience_ns: int = 0
    _waiting: deque[tuple[int, int]] = field(default_factory=deque)
    _counts_before: tuple[int, int] | None = None

    OVERRUN = "ECU overrun"

    def __post_init__(self) -> None:
        if self.role not in STATUS:
            raise TargetError(f"no ECU {self.role}; there are {', '.join(STATUS)}")
        self._status = self.codec.message(STATUS[self.role])
        self._timing = self.codec.message(TIMING[self.role])
        kind = self._status.signals.get("kind")
        self._kinds = {raw: name for raw, name in kind.names.items() if raw} if kind else {}

    def cycle(
        self, t_ns: int, number: int | None = None, excused: Callable[[int], bool] | None = None
    ) -> str | None:
        """The logger starts its next input cycle at `t_ns`: what was wrong with those before, if anything.

        number: the logger's count of it, where cycles may have been lost. excused: says of a cycle's instant
        whether it may go without an answer; such ones are counted in `unanswered_cycles`.
        """
        failure = None
        while self._waiting and self._waiting[0][1] + self.patience_ns <= t_ns:
            if excused and excused(self._waiting[0][1]):
                self.unanswered_cycles += 1
            else:
                failure = failure or self.unanswered(t_ns)
            self._waiting.popleft()
        self.cycles = self.cycles + 1 if number is None else number + 1
        self._waiting.append((self.cycles - 1, t_ns))
        return failure

    def unanswered(self, t_ns: int) -> str | None:
        """The complaint, if an input cycle has no answer at `t_ns`."""
        if not self._waiting:
            return None
        number, sent_ns = self._waiting[0]
        return (
            f"{self.OVERRUN}: no answer to cycle {number}, sent at {sent_ns / 1e9:.9g} s, "
            f"by {t_ns / 1e9:.9g} s"
        )

    def _answers(self, alive: int) -> None:
        """Strike off the cycle whose count an answer echoes, and those before it: the ECU is past them."""
        for k, (number, _) in enumerate(self._waiting):
            if number & 15 == alive:
                for _ in range(k + 1):
                    self._waiting.popleft()
                return

    def heard(self, frame: Frame, t_ns: int) -> None:
        """A frame that ended at `t_ns`; frames of other identifiers pass."""
        message = {self._status.id: self._status, self._timing.id: self._timing}.get(frame.id)
        if message is None or frame.extended:
            return
        if len(frame.data) < message.length:
            self.garbled = self.garbled or (
                f"{message.name} of {len(frame.data)} bytes at {t_ns / 1e9:.9g} s; it has {message.length}"
            )
            return
        values = self.codec.decode(message.name, frame.data)
        if message is self._status:
            self._answers(int(values["alive"]))
            self.answered += 1
            self.answers.append(
                Answer(t_ns, float(values["predicted_mm"]), float(values.get("residual_pct", math.nan)))
            )
            self._alarm(bool(values.get("alarm", 0)), self._kinds.get(int(values.get("kind", 0))), t_ns)
        else:
            self.step_cycles.append(int(values["step_cycles"]))
            counts = int(values["missed_inputs"]), int(values["overruns"])
            before = self._counts_before = self._counts_before or counts
            self.missed_inputs, self.overruns = counts[0] - before[0], counts[1] - before[1]

    def _alarm(self, on: bool, kind: str | None, t_ns: int) -> None:
        raised = bool(self.alarms) and self.alarms[-1].off_ns is None
        if on and not raised:
            self.alarms.append(Alarm(t_ns, None, kind))
        elif raised and not on:
            self.alarms[-1] = self.alarms[-1]._replace(off_ns=t_ns)
