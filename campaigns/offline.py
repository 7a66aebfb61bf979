"""The offline campaign: which fault comes when, and the first alarm of every T, L and n after it.

Belongs here: drawing the faults, inserting them, the trials as jobs. Never: a rate, a table, a file.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from hashlib import sha256
from pathlib import PurePath
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from bench import pool
from bench.faults.spec import parse_fault
from bench.laps.lap import Lap
from campaigns.laps import Recorded, Simulated
from campaigns.offline_insertion import inserted, predicted
from campaigns.offline_lap import SAMPLE_NS, Cells, Course, course, feedbacks
from campaigns.offline_plan import SAMPLE_MS, OfflineCampaign, t_key
from campaigns.soft_sensor import WASHOUT
from campaigns.store import Document, Identified
from targets.calibration import Calibration
from targets.detector import Detector
from targets.narx import curves, measures
from targets.narx.network import Narx

Floats = NDArray[np.float64]
Tell = Callable[[str], None]

SOE_MS = 500
"""The window of figures V.6 and V.7 beside those of the tables."""
SOE_POINTS = 200


class Detects(Protocol):
    """A detector to run beside the thesis's on the same trials; it goes to workers by pickling."""

    def document(self) -> Document:
        """What decides its alarms, as plain data: part of the trials' identity."""

    def first_alarm(self, measured: Floats, predicted: Floats) -> tuple[int, str | None]:
        """The sample of its first alarm, -1 for none, and the kind of fault it named.

        measured, predicted: 100 Hz, mm, (samples,), from power-on until the fault counts as missed.
        """


@dataclass(frozen=True, eq=False)
class Prepared:
    """All that trials share: the laps with their predictions, the network, the detectors."""

    plan: OfflineCampaign
    network: Narx
    cells: Cells
    courses: tuple[Course, ...]
    others: Mapping[str, Detects] = field(default_factory=dict)

    @property
    def feedbacks(self) -> tuple[str, ...]:
        """Those of the plan that the network can be run with."""
        return feedbacks(self.plan, self.network)

    def shared(self) -> Document:
        """What every trial's document holds."""
        return {
            "model_sha256": model_sha256(self.network),
            "sensors": self.plan.sensors,
            "t_max_s": self.plan.t_max_s,
            "detectors": {
                "threshold": self.cells.document(),
                **{name: other.document() for name, other in self.others.items()},
            },
        }


def model_sha256(network: Narx) -> str:
    """What identifies a network: the digest of its calibration image, with any detector the same."""
    return sha256(Calibration(network).image()).hexdigest()


def prepare(
    plan: OfflineCampaign,
    laps: Sequence[Lap] | None,
    calibration: Calibration,
    tell: Tell = lambda _: None,
    workers: int = 1,
    others: Mapping[str, Detects] | None = None,
) -> Prepared:
    """Ride the plan's laps, or take `laps`, and predict each in every feedback.

    Of the calibration's detector only warm-up and floor are taken, T, L and n are the plan's.
    Raises LapError for a lap that lacks a channel, CampaignError for one too short for a fault.
    """
    network, chosen = calibration.network, calibration.detector
    detector = chosen if isinstance(chosen, Detector) else Detector(warmup=chosen.warmup)
    numbers: Sequence[Lap | int]
    numbers = list(laps) if laps is not None else range(plan.test.seed, plan.test.seed + plan.test.count)
    found = []
    work = partial(_course, plan=plan, network=network, detector=detector)
    for one in pool.results(work, numbers, workers):
        found.append(one)
        tell(one.name)
    return Prepared(plan, network, Cells.of(plan, detector), tuple(found), others or {})


def _course(which: Lap | int, plan: OfflineCampaign, network: Narx, detector: Detector) -> Course:
    if isinstance(which, Lap):
        recorded = Recorded(PurePath(which.source).name, which.digest())
        return course(which, recorded.document(), 0, plan, network, detector)
    simulated = Simulated(plan.test.route, plan.test.motorcycle, which)
    return course(simulated.ridden(), simulated.document(), which, plan, network, detector)


@dataclass(frozen=True)
class OfflineTrial(Identified):
    """One fault in one lap, for one feedback. fault: its specification. lap: which of the prepared ones."""

    condition: str
    number: int
    feedback: str
    fault: str
    lap: int
    shared: Document = field(repr=False, compare=False)

    def document(self) -> Document:
        """See `Identified`; number: two faults may be drawn alike, and both count."""
        return {
            "kind": "offline",
            "condition": self.condition,
            "number": self.number,
            "feedback": self.feedback,
            "fault": self.fault,
            **self.shared,
        }

    def result(self, prepared: Prepared) -> Document:
        """Insert the fault and find the first alarms; times in ns after the lap's start, None for never."""
        one = prepared.courses[self.lap]
        healthy = one.healthy[self.feedback]
        faulty = inserted(one, self.fault, prepared.network, prepared.plan.t_max_s)
        result: Document = {
            "t_cmd_ns": faulty.t_cmd_ns,
            "t_active_ns": faulty.t_active_ns,
            "t_obs_ns": faulty.t_obs_ns,
            "first_alarm_ns": None,
        }
        if faulty.t_active_ns is None:
            return result
        start, stop = faulty.start, len(faulty.y)
        y_p = predicted(prepared.network, self.feedback, healthy.predicted, faulty)
        before = (healthy.alarms >= 0) & (healthy.alarms < start)
        after = prepared.cells.first_alarms(faulty.y, y_p, start, stop)
        first = np.where(before, healthy.alarms, after)
        result["first_alarm_ns"] = {
            t_key(t): [[_ns(k) for k in row] for row in first[j].tolist()]
            for j, t in enumerate(prepared.cells.T_percent)
        }
        others: Document = {}
        for name, other in prepared.others.items():
            at, named = other.first_alarm(faulty.y, y_p)
            others[name] = {"first_alarm_ns": _ns(at), "named": named}
        return {**result, "others": others} if others else result


@dataclass(frozen=True)
class SoeTrial(Identified):
    """Figures V.6 and V.7: how often the healthy laps' residual exceeds a tolerance, for one feedback."""

    feedback: str
    laps: Sequence[Document] = field(repr=False)
    L_ms: tuple[int, ...]
    shared: Document = field(repr=False, compare=False)

    def document(self) -> Document:
        """See `Identified`."""
        return {
            "kind": "offline_soe",
            "feedback": self.feedback,
            "L_ms": list(self.L_ms),
            "laps": list(self.laps),
            **self.shared,
        }

    def result(self, prepared: Prepared) -> Document:
        """Each L's survivor function of E_mean,L, percent, its share beyond each T, its worst windows."""
        pairs = [(one.healthy[self.feedback].predicted, one.y) for one in prepared.courses]
        errors = measures.deviations(pairs, WASHOUT, prepared.cells.floor_mm)
        found = {}
        for ms in self.L_ms:
            samples = ms // SAMPLE_MS
            curve = curves.soe(errors, samples, SOE_POINTS)
            means = np.concatenate([measures.sliding_mean(run, samples) for run in errors])
            found[str(ms)] = {
                "beyond": {t_key(t): float(np.mean(means > t)) for t in prepared.cells.T_percent},
                "worst_tenth_percent": curves.least_of_worst(errors, samples),
                "worst_hundredth_percent": curves.least_of_worst(errors, samples, 0.01),
                "tolerance_percent": curve.tolerance_percent.tolist(),
                "share": curve.share.tolist(),
            }
        return {"curves": found}


Job = OfflineTrial | SoeTrial


def jobs(prepared: Prepared) -> list[Job]:
    """Every trial of the campaign: the curves first, then condition by condition, feedback by feedback.

    A fault is drawn from the seed, its condition and its number alone; every feedback gets the same faults.
    """
    plan, shared = prepared.plan, prepared.shared()
    laps = [{"lap": one.lap, "sensors_seed": one.sensors_seed} for one in prepared.courses]
    windows = tuple(sorted({*plan.L_ms, SOE_MS}))
    found: list[Job] = [SoeTrial(feedback, laps, windows, shared) for feedback in prepared.feedbacks]
    instants = np.cumsum([one.last_ms - one.first_ms + 1 for one in prepared.courses])
    for condition, fault in plan.faults.items():
        for number in range(plan.faults_per_kind):
            lap, at_ms = _draw(plan.seed, condition, number, instants)
            at_ms += prepared.courses[lap].first_ms
            spec = str(parse_fault(f"{fault}@{at_ms // 1000}.{at_ms % 1000:03d}"))
            found += [
                OfflineTrial(condition, number, feedback, spec, lap, {**laps[lap], **shared})
                for feedback in prepared.feedbacks
            ]
    return found


def _draw(seed: int, condition: str, number: int, instants: NDArray[np.int64]) -> tuple[int, int]:
    """A lap, and a millisecond of those in it; all of all laps are equally likely."""
    name = int.from_bytes(sha256(condition.encode()).digest()[:8])
    rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence((seed, name, number))))
    drawn = int(rng.integers(instants[-1]))
    lap = int(np.searchsorted(instants, drawn, side="right"))
    return lap, drawn - (int(instants[lap - 1]) if lap else 0)


def work(job: Job, prepared: Prepared) -> tuple[Document, None]:
    """Carry out one trial, as a campaign's runner wants it: its result, and no freeze frame."""
    return job.result(prepared), None


def _ns(sample: int) -> int | None:
    return sample * SAMPLE_NS if sample >= 0 else None
