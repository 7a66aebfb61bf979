"""The freeze frame of a run: what was measured, predicted and decided around its instants."""

from typing import Any

from bench.mdlog.logger import sampled
from bench.run import Run
from bench.sensors.transducers import TRANSDUCERS
from bench.verdict import MONITORED

PERIOD_NS = 10_000_000
BEFORE_NS, AFTER_NS = 2_000_000_000, 1_000_000_000
UNFOUND_NS = 10_000_000_000
"""Shown of a fault that no alarm followed."""
MOST = 1000
"""Samples of a frame; a longer stretch is thinned out."""


def freeze(run: Run) -> dict[str, Any] | None:
    """From 2 s before a run's first instant to 1 s after its last; None for a run without any, or of no
    answer.

    {"t0_ns", "period_ns", "measured_mm", "predicted_mm", "residual_pct"}, equally spaced.
    """
    verdict, answers = run.verdict, run.watch.answers
    instants = [
        t
        for t in (verdict.t_cmd_ns, verdict.t_active_ns, verdict.t_obs_ns, verdict.t_alarm_ns)
        if t is not None
    ]
    channel = TRANSDUCERS[MONITORED].channel
    if not instants or not answers or MONITORED not in run.codes.codes:
        return None
    last = max(instants) + (AFTER_NS if verdict.t_alarm_ns is not None else UNFOUND_NS)
    begin = max(0, (min(instants) - BEFORE_NS) // PERIOD_NS)
    end = min(len(answers), -(-last // PERIOD_NS))
    step = max(1, -(-(end - begin) // MOST))
    if end <= begin:
        return None
    measured = sampled(run.codes)[channel][begin:end:step]
    shown = answers[begin:end:step]
    return {
        "t0_ns": begin * PERIOD_NS,
        "period_ns": step * PERIOD_NS,
        "measured_mm": [round(float(value), 3) for value in measured],
        "predicted_mm": [round(answer.predicted_mm, 3) for answer in shown],
        "residual_pct": [round(answer.residual_pct, 2) for answer in shown],
    }
