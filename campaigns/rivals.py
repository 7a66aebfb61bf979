"""Detectors side by side: the checks and the baselines of a calibration, on the offline campaign's faults.

Belongs here: each as the offline campaign runs it, and the table that compares them. Never: a fault, a lap.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from campaigns.outcomes import expected_kind, finite, rate
from campaigns.sheets import NONE, Cell, Sheet, percent, seconds
from campaigns.statistics import times
from campaigns.store import Document
from targets import baselines
from targets.baselines import Baseline
from targets.calibration import Calibration
from targets.checks import KINDS, first_alarm
from targets.detector import Checks

Floats = NDArray[np.float64]
CHECKS = "second detector"
TITLES = {
    "residual": "residual (V.1), T tuned",
    "persistence": "threshold, 0.2 s persistence",
    "cusum": "two-sided CUSUM",
}
NAMES = (CHECKS, *TITLES.values())
"""In the order in which they are compared."""


@dataclass(frozen=True)
class ChecksRival:
    """The second detector: see `campaigns.offline.Detects`."""

    checks: Checks

    def document(self) -> Document:
        """What decides its alarms."""
        return {"type": self.checks.TYPE, **asdict(self.checks)}

    def first_alarm(self, measured: Floats, predicted: Floats) -> tuple[int, str | None]:
        """The first alarm since power-on, and the kind it names."""
        at, named = first_alarm(predicted, measured, 0, self.checks)
        return (-1, None) if at is None else (at, named if named != KINDS[0] else None)


@dataclass(frozen=True)
class BaselineRival:
    """A baseline, silent for as long as the checks warm up."""

    baseline: Baseline
    warmup: int

    def document(self) -> Document:
        """What decides its alarms."""
        return {"type": type(self.baseline).__name__.lower(), "warmup": self.warmup, **vars(self.baseline)}

    def first_alarm(self, measured: Floats, predicted: Floats) -> tuple[int, str | None]:
        """The first alarm since the warm-up's end; it names no kind."""
        at = baselines.first_alarm(self.baseline, predicted, measured, self.warmup)
        return (-1 if at is None else at), None


def rivals(calibration: Calibration) -> dict[str, ChecksRival | BaselineRival]:
    """The detectors to compare: those that `bench calibrate ifd` put into the calibration, none otherwise."""
    checks = calibration.detector
    if not isinstance(checks, Checks):
        return {}
    found: dict[str, ChecksRival | BaselineRival] = {CHECKS: ChecksRival(checks)}
    for name, table in calibration.baselines.items():
        baseline = baselines.read(name, table)
        found[TITLES[name]] = BaselineRival(baseline, checks.warmup)
    return found


def compared(
    rows: Iterable[tuple[Mapping[str, Any], Mapping[str, Any]]], order: Sequence[str], t_max_s: float
) -> list[Document]:
    """One document a condition and detector: outcomes, kinds named right, times to detect.

    rows: trials' documents with their results; only those with the network's own prediction fed back count.
    order: the conditions as they shall stand.
    """
    groups: dict[tuple[str, str], list[tuple[str, Mapping[str, Any], Mapping[str, Any]]]] = {}
    for trial, result in rows:
        if trial["kind"] != "offline" or trial["feedback"] != "predicted" or result["t_active_ns"] is None:
            continue
        for name, other in result.get("others", {}).items():
            groups.setdefault((trial["condition"], name), []).append((trial["fault"], result, other))
    ordered = sorted(groups.items(), key=lambda item: (order.index(item[0][0]), NAMES.index(item[0][1])))
    return [_one(condition, name, group, t_max_s) for (condition, name), group in ordered]


def _one(condition: str, name: str, group: Sequence[Any], t_max_s: float) -> Document:
    counts = {"FA": 0, "CD": 0, "MD": 0}
    right = judged = 0
    delays = []
    for fault, result, other in group:
        at, active = other["first_alarm_ns"], result["t_active_ns"]
        if at is None or at - active > t_max_s * 1e9:
            counts["MD"] += 1
        elif at < active:
            counts["FA"] += 1
        else:
            counts["CD"] += 1
            delays.append(at - active)
            kind = expected_kind(fault)
            if other["named"] is not None and kind is not None:
                judged += 1
                right += other["named"] == kind
    td = times(delays)
    return {
        "key": f"{condition}/{name}",
        "condition": condition,
        "detector": name,
        "n": len(group),
        **counts,
        "rates": {outcome: rate(hits, len(group)) for outcome, hits in counts.items()},
        "named": {"right": right, "n": judged, **rate(right, judged)},
        "td_s": {
            "mean": finite(td.mean),
            "sigma": finite(td.deviation),
            "median": finite(td.median),
            "p95": finite(td.percentile(95)),
            "max": finite(td.longest),
        },
    }


def compared_sheet(found: Sequence[Document]) -> Sheet:
    """The comparison as a table: each condition's detectors below one another."""
    heads = ["Fault", "detector", "n", "FA %", "CD %", "95 % interval", "MD %", "kind right %"]
    rows = []
    for one in found:
        key, rates, td = one["key"], one["rates"], one["td_s"]
        low, high = rates["CD"]["interval"]
        right = one["named"]["value"]
        cells = [Cell(one["condition"]), Cell(one["detector"]), Cell(str(one["n"]), f"{key}.n", one["n"])]
        cells += [_share(key, "FA", rates["FA"]["value"]), _share(key, "CD", rates["CD"]["value"])]
        cells += [Cell(f"{percent(low)}-{percent(high)}"), _share(key, "MD", rates["MD"]["value"])]
        cells += [Cell(NONE if right is None else percent(right), f"{key}.named.value", right)]
        for name in ("mean", "p95", "max"):
            value = td[name]
            cells.append(Cell(NONE if value is None else seconds(value), f"{key}.td_s.{name}", value))
        rows.append(cells)
    note = (
        "On the faults of the tables above, the network's own prediction fed back. All have the same budget "
        "of false alarms, from the same fault-free laps."
    )
    return Sheet("Detectors compared", [*heads, "mean TD, s", "p95", "max"], rows, note)


def _share(key: str, outcome: str, value: float | None) -> Cell:
    return Cell(NONE if value is None else percent(value), f"{key}.rates.{outcome}.value", value)
