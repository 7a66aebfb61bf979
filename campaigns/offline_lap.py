"""Laps as the offline campaign looks at them: codes, 100 Hz samples, predictions, the healthy lap's alarms.

Belongs here: what is the same for every fault of a lap, and how the network is run over it. Never: a fault,
an outcome.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.laps.lap import Lap
from bench.mdlog.logger import sampled_codes
from bench.sensors.codes import Codes, acquire
from bench.sensors.datasheets import load_sensors
from bench.sensors.transducers import BY_CHANNEL, Transducer
from campaigns.errors import CampaignError
from campaigns.offline_kernel import first_alarms
from campaigns.offline_plan import SAMPLE_MS, OfflineCampaign
from campaigns.soft_sensor import RATE_HZ
from targets.detector import Detector
from targets.narx.network import Narx
from targets.narx.prepare import normalised, physical
from targets.narx.recursion import forward, packed

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

SAMPLE_NS = SAMPLE_MS * 1_000_000
LEAST_S = 1.0
"""What a lap must last beyond the detector's warm-up."""


@dataclass(frozen=True)
class Cells:
    """Every T, L and n of the tables, and the rest of the detector they share."""

    T_percent: tuple[float, ...]
    L_ms: tuple[int, ...]
    n: tuple[int, ...]
    floor_mm: float
    warmup: int

    @classmethod
    def of(cls, plan: OfflineCampaign, detector: Detector) -> "Cells":
        """The plan's cells with the calibration's floor and warm-up."""
        return cls(
            tuple(float(t) for t in plan.T_percent),
            tuple(plan.L_ms),
            tuple(plan.n),
            detector.floor_mm,
            detector.warmup,
        )

    @cached_property
    def _arrays(self) -> tuple[Floats, Integers, Integers]:
        return (
            np.array(self.T_percent) / 100.0,
            np.array(self.L_ms, dtype=np.int64) // SAMPLE_MS,
            np.array(self.n, dtype=np.int64),
        )

    @property
    def history(self) -> int:
        """Samples before a fault that can still decide: the longest run of exceedances, of whole windows."""
        _, windows, multiples = self._arrays
        return int(windows[-1] * (multiples[-1] + 1))

    def first_alarms(self, measured: Floats, predicted: Floats, start: int, stop: int) -> Integers:
        """The sample of [start, stop) at which each cell first raises its alarm, else -1; (T, L, n).

        Begins `history` samples earlier: an alarm raised in those is found, too.
        """
        thresholds, windows, multiples = self._arrays
        begin = max(start - self.history, 0)
        skip = max(self.warmup - begin, 0)
        found = np.empty((thresholds.size, windows.size, multiples.size), dtype=np.int64)
        within = slice(begin, stop)
        first_alarms(
            measured[within], predicted[within], self.floor_mm, thresholds, windows, multiples, skip, found
        )
        return np.where(found < 0, -1, found + begin)

    def document(self) -> dict[str, Any]:
        """What decides an alarm, as plain data."""
        return {
            "T_percent": list(self.T_percent),
            "L_ms": list(self.L_ms),
            "n": list(self.n),
            "floor_mm": self.floor_mm,
            "warmup": self.warmup,
        }


def free_run(network: Narx, u: Floats) -> Floats:
    """Predictions (T,) fed back with themselves; a shifted network begins with what its delay line holds."""
    ahead = np.full(network.shift, network.initial_mm)
    return np.concatenate([ahead, network.free_run(u)])[: len(u)]


def fed_measured(network: Narx, u: Floats, y: Floats, start: int) -> Floats:
    """Predictions (T - start,) from sample `start` on, fed back with the measured stroke `y` (T,).

    `Narx.one_step` without what lies before, and with the loop's own sums: the same bits for every start.
    """
    d = network.delays
    lags = np.maximum(np.arange(start - d, len(y)), 0)
    v = np.stack([normalised(u[lags, j], span) for j, span in enumerate(network.input_ranges)], axis=1)
    rest = np.full(d, network.initial_mm)
    fed = normalised(np.concatenate([rest, y])[start:], network.output_range)
    out = np.empty(len(y) - start)
    forward(
        *packed(network.W1, network.b1, network.w2), network.b2, v, fed[:d][::-1].copy(), False, fed[d:], out
    )
    return physical(out, network.output_range)


@dataclass(frozen=True, eq=False)
class Healthy:
    """A lap without a fault, in one feedback: predictions (T,), mm, and each cell's first alarm (T, L, n)."""

    predicted: Floats
    alarms: Integers


@dataclass(frozen=True, eq=False)
class Course:
    """A lap to insert faults into.

    lap: its document, name: its source. codes: the sensors that get faults, at the lap's instants.
    latest (T,): which of those instants each 100 Hz sample holds. u (T, n_u), y (T,): what the ECU sees.
    first_ms, last_ms: the first and last whole millisecond at which a fault begins.
    healthy: feedback -> the lap without a fault.
    """

    lap: dict[str, Any]
    name: str
    sensors_seed: int
    codes: Codes
    latest: NDArray[np.int32]
    u: Floats
    y: Floats
    first_ms: int
    last_ms: int
    healthy: dict[str, Healthy]


def feedbacks(plan: OfflineCampaign, network: Narx) -> tuple[str, ...]:
    """The plan's feedbacks that this network can be run with.

    One that looks ahead has no measured value to be fed back with. Raises CampaignError if none is left.
    """
    found = tuple(name for name in plan.feedback if name == "predicted" or not network.shift)
    if not found:
        raise CampaignError(
            f"feedback measured: the model looks {network.shift} samples ahead, which cannot be measured yet"
        )
    return found


def faulted(plan: OfflineCampaign, network: Narx) -> tuple[str, ...]:
    """The sensors that get faults. Raises CampaignError for one that the network does not see."""
    from bench.faults.spec import parse_fault

    seen = [BY_CHANNEL[channel].sensor for channel in (network.output, *network.inputs)]
    found = {condition: parse_fault(f"{fault}@0").sensor for condition, fault in plan.faults.items()}
    for condition, sensor in found.items():
        if sensor not in seen:
            raise CampaignError(
                f"fault {condition}: the model does not see {sensor}; it sees {', '.join(seen)}"
            )
    return tuple(dict.fromkeys(found.values()))


def course(
    lap: Lap, document: dict[str, Any], seed: int, plan: OfflineCampaign, network: Narx, detector: Detector
) -> Course:
    """Take a lap through sensors (their imperfections drawn from `seed`) and logger, and predict it.

    Raises LapError for one that lacks a channel, CampaignError for one too short for a fault.
    """
    lap.require((*network.inputs, network.output), "the offline campaign")
    needed_s = detector.warmup / RATE_HZ + LEAST_S
    if lap.duration_ns < needed_s * 1e9:
        raise CampaignError(
            f"{lap.source or 'lap'}: lasts {lap.duration_ns / 1e9:.9g} s, and a fault needs {needed_s:g} s: "
            f"the detector's warm-up of {detector.warmup / RATE_HZ:g} s and {LEAST_S:g} s more"
        )
    every = acquire(lap, load_sensors(plan.sensors), seed)
    # the logger's own choice of samples, as indices: codes that count their instants
    counted = Codes(every.t_ns, {"sample": np.arange(len(every.t_ns), dtype=np.int32)})
    latest = sampled_codes(counted, RATE_HZ)["sample"]
    u = np.stack([sampled(every, BY_CHANNEL[name], latest) for name in network.inputs], axis=1)
    y = sampled(every, BY_CHANNEL[network.output], latest)
    cells = Cells.of(plan, detector)
    healthy = {}
    for feedback in feedbacks(plan, network):
        predicted = free_run(network, u) if feedback == "predicted" else fed_measured(network, u, y, 0)
        healthy[feedback] = Healthy(predicted, cells.first_alarms(y, predicted, 0, len(y)))
    first_ms = detector.warmup * SAMPLE_MS
    end_ms = int(every.t_ns[-1]) // 1_000_000
    # what is watched after a fault: t_max, or half of what the warm-up leaves of a short lap
    last_ms = end_ms - min(round(plan.t_max_s * 1000), (end_ms - first_ms) // 2)
    codes = Codes(every.t_ns, {sensor: every.codes[sensor] for sensor in faulted(plan, network)})
    return Course(document, lap.source or "lap", seed, codes, latest, u, y, first_ms, last_ms, healthy)


def sampled(codes: Codes, sensor: Transducer, latest: NDArray[np.int32]) -> Floats:
    """What the ECU decodes of a sensor's codes at the samples `latest`, in the channel's unit."""
    return sensor.to_physical(codes.codes[sensor.sensor][latest])
