"""The verdict on one run: what was detected, when, and whether the run counts at all. Pure.

Outcomes and instants as the field uses them: CD correct detection, MD missed, FA false alarm (section V.3),
ID a detection that names the wrong sensor or kind, INVALID a run that proves nothing, OK no fault and no
alarm.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

from bench.faults.insertion import Insertion
from bench.faults.places import BUS
from bench.watch import Alarm, Watch

TD_MAX_NS = 120_000_000_000
"""t_max of section V.3: a detection later than this is a missed one."""

MONITORED = "rear_stroke"
"""The sensor whose faults the IFD's alarm names."""

CARRIERS = ("STROKES", BUS)
"""Where a fault of the bus strikes what that sensor says."""


class Outcome(StrEnum):
    """Of one run."""

    CD = "CD"
    MD = "MD"
    FA = "FA"
    ID = "ID"
    INVALID = "INVALID"
    OK = "OK"

    @property
    def passed(self) -> bool:
        """A fault was found, or there was none and no alarm."""
        return self in (Outcome.CD, Outcome.OK)


@dataclass(frozen=True)
class Verdict:
    """Outcome, its reason in words, and the instants in ns after the lap's start (None: did not happen).

    t_alarm_ns: the first alarm on the bus. t_heal_ns: when that alarm was taken back. named: the kind of
    fault that alarm named, None if it named none.
    """

    outcome: Outcome
    reason: str
    t_cmd_ns: int | None = None
    t_active_ns: int | None = None
    t_obs_ns: int | None = None
    t_alarm_ns: int | None = None
    t_heal_ns: int | None = None
    named: str | None = None

    @property
    def td_ns(self) -> int | None:
        """Time to detect, t_alarm - t_active, of a correct detection."""
        if self.outcome is not Outcome.CD or self.t_alarm_ns is None or self.t_active_ns is None:
            return None
        return self.t_alarm_ns - self.t_active_ns


def judge(
    watch: Watch,
    insertions: Sequence[Insertion],
    failure: str | None = None,
    td_max_ns: int = TD_MAX_NS,
) -> Verdict:
    """The verdict on a run that `watch` followed while `insertions` acted; failure: why the rig gave up.

    With several faults the first to act is the one to detect.
    """
    alarm = watch.alarms[0] if watch.alarms else None
    first = min(insertions, key=lambda i: (i.t_active_ns is None, i.t_active_ns or 0), default=None)
    on_bus = any(insertion.spec.on_bus for insertion in insertions)
    invalid = failure or _unusable(watch, on_bus) or _never_acted(first)
    outcome, reason = _outcome(invalid, first, alarm, td_max_ns)
    return Verdict(
        outcome,
        reason,
        first.t_cmd_ns if first else None,
        first.t_active_ns if first else None,
        first.t_obs_ns if first else None,
        alarm.on_ns if alarm else None,
        alarm.off_ns if alarm else None,
        alarm.kind if alarm else None,
    )


def _outcome(
    invalid: str | None, fault: Insertion | None, alarm: Alarm | None, td_max_ns: int
) -> tuple[Outcome, str]:
    t_alarm = alarm.on_ns if alarm else None
    if invalid:
        return Outcome.INVALID, invalid
    if fault is None or fault.t_active_ns is None:
        if t_alarm is None:
            return Outcome.OK, "no fault, no alarm"
        return Outcome.FA, f"alarm at {_s(t_alarm)} without a fault"
    if t_alarm is None:
        return Outcome.MD, f"no alarm after {fault.spec}"
    if t_alarm < fault.t_active_ns:
        return Outcome.FA, f"alarm at {_s(t_alarm)}, before the fault acted at {_s(fault.t_active_ns)}"
    end = None if fault.spec.duration_ns is None else fault.t_cmd_ns + fault.spec.duration_ns
    if end is not None and t_alarm >= end:
        return Outcome.FA, f"alarm at {_s(t_alarm)}, when no fault was active any more (since {_s(end)})"
    late = t_alarm - fault.t_active_ns
    if late > td_max_ns:
        return Outcome.MD, f"alarm {_s(late)} after the fault, later than {_s(td_max_ns)}"
    if fault.spec.sensor not in (MONITORED, *CARRIERS):
        return Outcome.ID, f"the alarm names {MONITORED}, the fault was on {fault.spec.sensor}"
    called = fault.spec.called
    if alarm and alarm.kind and called and alarm.kind != called:
        return Outcome.ID, f"the alarm {_s(late)} after the fault names {alarm.kind}, it was {called}"
    return Outcome.CD, f"alarm {_s(late)} after the fault acted"


def _unusable(watch: Watch, on_bus: bool) -> str | None:
    """on_bus: faults of the bus were asked for; lost frames are their work, not the rig's."""
    if watch.garbled:
        return f"unreadable answer: {watch.garbled}"
    if watch.missed_inputs and not on_bus:
        return f"frames lost: the ECU missed {watch.missed_inputs} input cycles"
    if watch.overruns and not on_bus:
        return f"{Watch.OVERRUN}: {watch.overruns} input cycles waited for the step before"
    return None


def _never_acted(fault: Insertion | None) -> str | None:
    if fault is not None and fault.t_active_ns is None:
        return f"the fault {fault.spec} never acted: every sample is as without it"
    return None


def _s(t_ns: int) -> str:
    return f"{t_ns / 1e9:.3f} s"
