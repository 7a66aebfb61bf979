"""What a ground station is told without having asked: heartbeat, named values, alarms.

Belongs here: which message when. Never: packets, commands, a socket, a clock.
"""

import math
from collections.abc import Callable, Iterator
from typing import Any

from bench.mavlink.packets import common
from bench.panel import Panel
from bench.watch import Alarm, Watch

SECOND_NS = 1_000_000_000
VALUES_HZ = 10
_NAME, _TEXT = 10, 50
"""Longest name of a value and longest text, in bytes."""


class Telemetry:
    """Messages about the ECU that `watch` follows, None where there is none, under the faults of `panel`.

    speed: bench time over the wall's; heartbeats (1 Hz) and values (10 Hz) keep to the wall's. load: the
    bus's load since the last call, in %, None where that is not known yet.
    """

    def __init__(
        self,
        watch: Watch | None,
        panel: Panel,
        speed: float = 1.0,
        load: Callable[[int], float | None] = lambda _: None,
    ) -> None:
        self._watch, self._panel, self._load = watch, panel, load
        self._heartbeat = _Every(round(SECOND_NS * speed))
        self._values = _Every(round(SECOND_NS * speed / VALUES_HZ))
        self._answers = self._steps = self._raised = self._lowered = 0

    def due(self, t_ns: int) -> Iterator[Any]:
        """The messages to be sent at bench time `t_ns`."""
        if self._heartbeat.due(t_ns):
            yield self._state()
        yield from self._alarms(t_ns)
        if self._values.due(t_ns):
            yield from self._named(t_ns)

    def _state(self) -> Any:
        up = self._watch and self._watch.alarms and self._watch.alarms[-1].off_ns is None
        return common().MAVLink_heartbeat_message(
            common().MAV_TYPE_GENERIC,
            common().MAV_AUTOPILOT_INVALID,
            common().MAV_MODE_FLAG_HIL_ENABLED,
            0,
            common().MAV_STATE_CRITICAL if up else common().MAV_STATE_ACTIVE,
            3,
        )

    def _named(self, t_ns: int) -> Iterator[Any]:
        """What has been heard since the last time."""
        values: dict[str, float | None] = {"busload": self._load(t_ns)}
        if self._watch and len(self._watch.answers) > self._answers:
            self._answers = len(self._watch.answers)
            answer = self._watch.answers[-1]
            values |= {"residual": answer.residual_pct, "predicted": answer.predicted_mm}
        if self._watch and len(self._watch.step_cycles) > self._steps:
            self._steps = len(self._watch.step_cycles)
            values["step_cyc"] = self._watch.step_cycles[-1]
        for name, value in values.items():
            if value is not None and math.isfinite(value):
                # the clock is of 32 bits: 49 days
                yield common().MAVLink_named_value_float_message(
                    t_ns // 1_000_000 & 0xFFFFFFFF, name.encode()[:_NAME], value
                )

    def _alarms(self, t_ns: int) -> Iterator[Any]:
        """One text for every alarm that has been raised, one for every one that has been taken back."""
        alarms = self._watch.alarms if self._watch else []
        while self._lowered < len(alarms):
            alarm = alarms[self._lowered]
            if self._raised == self._lowered:
                self._raised += 1
                yield _text(
                    common().MAV_SEVERITY_ALERT, f"alarm{_kind(alarm)}, {self._detected(alarm, t_ns)}"
                )
            if alarm.off_ns is None:
                return
            self._lowered += 1
            lasted_s = (alarm.off_ns - alarm.on_ns) / 1e9
            yield _text(
                common().MAV_SEVERITY_NOTICE, f"alarm{_kind(alarm)} taken back after {lasted_s:.3f} s"
            )

    def _detected(self, alarm: Alarm, t_ns: int) -> str:
        """The time to detect the fault that was there first, of those that acted when the alarm came."""
        known = [entry.insertion for entry in self._panel.entries(t_ns) if entry.insertion]
        acted = [
            i.t_active_ns
            for i in known
            if i.t_active_ns is not None
            and i.t_active_ns <= alarm.on_ns
            and (i.t_end_ns is None or i.t_end_ns > alarm.on_ns)
        ]
        return f"TD {(alarm.on_ns - min(acted)) / 1e9:.3f} s" if acted else "no fault active"


class _Every:
    """An instant of every period; what was missed is not made up for."""

    def __init__(self, period_ns: int) -> None:
        self._period_ns, self._next_ns = period_ns, 0

    def due(self, t_ns: int) -> bool:
        if t_ns < self._next_ns:
            return False
        self._next_ns = (t_ns // self._period_ns + 1) * self._period_ns
        return True


def _kind(alarm: Alarm) -> str:
    return f" {alarm.kind}" if alarm.kind else ""


def _text(severity: int, text: str) -> Any:
    return common().MAVLink_statustext_message(severity, text.encode()[:_TEXT])
