"""An ECU as a listener sees it: its alarm, its residual, what its steps cost."""

from bench.codec import Codec
from bench.monitor.rows import EcuRow
from bench.watch import STATUS, TIMING, Alarm, Watch
from targets.ecu import Frame

_KEPT = 16
"""Answers, steps and alarms that the watch may hold; a listener may listen for days."""


class EcuState:
    """The ECU of `role`; clock_hz: of its CPU, threshold_pct: of its residual, None if it is not known."""

    def __init__(self, codec: Codec, role: str, clock_hz: float, threshold_pct: float | None) -> None:
        self._watch = Watch(codec, role)
        self._clock_hz, self._threshold_pct = clock_hz, threshold_pct
        self._worst_cycles = 0
        self._forgotten = 0

    @staticmethod
    def messages(role: str) -> tuple[str, str]:
        """The two messages it sends."""
        return STATUS[role], TIMING[role]

    @property
    def heard_of(self) -> bool:
        """It has sent something."""
        return bool(self._watch.answered or self._watch.step_cycles)

    @property
    def alarm(self) -> Alarm | None:
        """The latest alarm."""
        return self._watch.alarms[-1] if self._watch.alarms else None

    def heard(self, t_ns: int, frame: Frame) -> None:
        """One of its frames, of the length the DBC says."""
        watch = self._watch
        watch.heard(frame, t_ns)
        if watch.step_cycles:
            self._worst_cycles = max(self._worst_cycles, watch.step_cycles[-1])
        self._forgotten += max(len(watch.alarms) - _KEPT, 0)
        for kept in (watch.answers, watch.step_cycles, watch.alarms):
            del kept[:-_KEPT]

    def row(self, now_ns: int, cycles_per_s: float, td_s: float | None) -> EcuRow:
        """Its state at `now_ns`, where `cycles_per_s` of its answers come a second."""
        watch, alarm = self._watch, self.alarm
        step_s = watch.step_cycles[-1] / self._clock_hz if watch.step_cycles else None
        answer = watch.answers[-1] if watch.answers else None
        return EcuRow(
            role=watch.role,
            answers=watch.answered,
            predicted_mm=answer.predicted_mm if answer else None,
            residual_pct=answer.residual_pct if answer else None,
            threshold_pct=self._threshold_pct,
            alarm=alarm is not None and alarm.off_ns is None,
            kind=alarm.kind if alarm else None,
            alarms=self._forgotten + len(watch.alarms),
            since_s=None if alarm is None else (now_ns - (alarm.off_ns or alarm.on_ns)) / 1e9,
            td_s=td_s,
            step_s=step_s,
            worst_step_s=self._worst_cycles / self._clock_hz if watch.step_cycles else None,
            load=step_s * cycles_per_s if step_s is not None else None,
            missed_inputs=watch.missed_inputs,
            overruns=watch.overruns,
        )
