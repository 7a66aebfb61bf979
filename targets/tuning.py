"""Thresholds of the second detector from fault-free rides alone, for a stated budget of false alarms.

Every check compares one figure with one limit. How high that figure climbs without a fault is extrapolated
from its peaks (peaks over a threshold, with an exponential tail: peaks of a bounded error fall off faster) to
the level passed once in 1 / budget hours. Windows are chosen among a few by the time to detect faults put
into the same rides.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from targets.baselines import Baseline, Cusum, Persistence, Residual
from targets.checks import PER_MM, findings, log_ratios, rail_runs, repeat_runs, spreads
from targets.detector import Checks
from targets.errors import TrainingError

Floats = NDArray[np.float64]
Ride = tuple[Floats, Floats]
"""Predicted and measured stroke of a fault-free ride, mm, (T,) each, at RATE_HZ."""

RATE_HZ = 100
BLOCK = 1000
"""Samples whose highest value is one peak: ten seconds, so that one event on the road counts once."""
TAIL = 0.1
"""Share of the highest peaks that says how the tail falls."""
ENOUGH = 30
"""Peaks below which nothing can be said of a tail."""
LOSS_WINDOWS = (20, 30, 50, 75, 100, 150, 200, 300, 400, 500)
HOLD_WINDOWS = (20, 30, 40, 50, 75, 100)
PERSISTENCE = 20
"""Samples for which the first baseline has to stay above its threshold: 0.2 s, the thesis's L."""
EVERY = 1000
"""Samples from one fault put in to the next."""
NOISE_MM = 0.2
"""What still comes through of a held sensor's noise: seven codes of the rear stroke's, a poor harness."""
CHECKS = 4
"""Rail, repeat, motion and loss: each gets an equal share of the budget."""


@dataclass(frozen=True)
class Tuning:
    """The detector, and what its limits rest on.

    hours: fault-free riding it was tuned on. budget_per_hour: false alarms allowed. healthy: check -> the
    most that was seen without a fault, in its own unit. td_s: mean time to detect the faults put in, by kind.
    missed: share of them not found within ten seconds. baselines: by name, for the whole budget each.
    """

    checks: Checks
    hours: float
    budget_per_hour: float
    healthy: dict[str, float]
    td_s: dict[str, float]
    missed: dict[str, float]
    baselines: dict[str, Baseline]


def peaks(figure: Floats) -> Floats:
    """The highest value of every ten seconds, (T // BLOCK,); -inf where there is no figure at all."""
    whole = len(figure) // BLOCK
    return figure[: whole * BLOCK].reshape(whole, BLOCK).max(axis=1)


def limit(highs: Floats, hours: float, per_hour: float) -> float:
    """The level that peaks pass so many times per hour: `highs` of `hours` of riding; never below them."""
    highs = highs[np.isfinite(highs)]
    if highs.size < ENOUGH:
        return math.inf
    start = float(np.quantile(highs, 1 - TAIL))
    above = highs[highs > start] - start
    if above.size < 2:  # steps of an integer figure, say all zero
        return max(start, float(highs.max()))
    return max(float(highs.max()), start + float(above.mean()) * math.log(above.size / (hours * per_hour)))


def tune(rides: Sequence[Ride], per_hour: float, loss: float = 0.10, base: Checks | None = None) -> Tuning:
    """Set every limit and window of `base` from fault-free `rides`, for `per_hour` false alarms in all.

    loss: the gain error that has to be found, relative; where the rides err too much for that, `missed` says
    so. Raises TrainingError for rides that are too short.
    """
    checks = base or Checks()
    begin = max(checks.warmup, *LOSS_WINDOWS)
    rides = [(p, m) for p, m in rides if len(m) > begin + BLOCK]
    hours = sum(len(m) - begin for _, m in rides) / RATE_HZ / 3600
    if hours * 3600 < ENOUGH * BLOCK / RATE_HZ:
        raise TrainingError(
            f"{hours * 3600:.0f} s of fault-free riding, the detector needs {ENOUGH * BLOCK // RATE_HZ}"
        )
    if not per_hour > 0:
        raise TrainingError(f"a budget of {per_hour} false alarms per hour cannot be met")
    job = _Job(rides, begin, hours, per_hour / CHECKS)
    rail, repeat = job.counters(checks)
    checks = replace(checks, rail_steps=rail, repeat_steps=repeat)
    held = job.motion(checks)
    if held is not None:
        checks = replace(checks, hold_window=held.window, hold_ratio=math.exp(-held.level))
    lost = job.loss(checks, loss)
    checks = replace(checks, loss_window=lost.window, loss_threshold=lost.level)
    healthy = job.healthy(checks)
    return Tuning(
        checks,
        hours,
        per_hour,
        healthy,
        {"hold": held.td_s if held else math.nan, "uncalibration": lost.td_s},
        {"hold": held.missed if held else 1.0, "uncalibration": lost.missed},
        job.baselines(loss),
    )


class _Choice(NamedTuple):
    """A window with its limit, and what it needs to find the faults put in."""

    window: int
    level: float
    td_s: float
    missed: float


def _choice(window: int, level: float, seconds: list[Floats]) -> _Choice:
    all_s = np.concatenate(seconds)
    return _Choice(window, level, float(np.mean(all_s)), float(np.mean(all_s >= EVERY / RATE_HZ)))


@dataclass(frozen=True)
class _Job:
    rides: list[Ride]
    begin: int
    hours: float
    per_hour: float

    def peaks(self, figures: list[Floats]) -> Floats:
        return np.concatenate([peaks(figure[self.begin :]) for figure in figures])

    def limit(self, figures: list[Floats]) -> float:
        return limit(self.peaks(figures), self.hours, self.per_hour)

    def counters(self, c: Checks) -> tuple[int, int]:
        """So many steps at a rail, and with a repeated value, that no healthy sensor stays there."""
        low, high = c.rail_low_mm, c.rail_high_mm
        rails = [rail_runs(p, m, low, high, c.rail_gap_mm).astype(float) for p, m in self.rides]
        repeats = [repeat_runs(p, m, low, high, c.repeat_motion_mm).astype(float) for p, m in self.rides]
        return max(3, math.floor(self.limit(rails)) + 1), max(5, math.floor(self.limit(repeats)) + 1)

    def motion(self, checks: Checks) -> _Choice | None:
        """The window and ratio with which a held stroke is found soonest; None where nothing ever moves."""
        tried = []
        for window in HOLD_WINDOWS:
            level = self.limit([lag(p, m, window, checks.still_mm) for p, m in self.rides])
            if math.isfinite(level):
                seconds = [self._held(p, m, window, level, checks.still_mm) for p, m in self.rides]
                tried.append(_choice(window, max(level, 0.0), seconds))
        return min(tried, key=lambda choice: choice.td_s, default=None)

    def loss(self, checks: Checks, target: float) -> _Choice:
        """The window and threshold with which losing calibration, either way, is found soonest."""
        ratios = [log_ratios(p, m, checks.loss_floor_mm) for p, m in self.rides]
        tried = []
        for window in LOSS_WINDOWS:
            level = self.limit([np.abs(_mean(ratio, window)) for ratio in ratios])
            shifts = math.log1p(target), math.log1p(-target)
            seconds = [self._lost(ratio, window, level, shift) for ratio in ratios for shift in shifts]
            tried.append(_choice(window, min(level, 1.0), seconds))
        return min(tried, key=lambda choice: choice.td_s)

    def healthy(self, checks: Checks) -> dict[str, float]:
        """What each check reaches on the rides; TrainingError if one of them raised an alarm after all."""
        for p, m in self.rides:
            if findings(p, m, checks).alarm[self.begin :].any():
                raise TrainingError("an alarm on a fault-free ride in spite of its limits")
        low, high = checks.rail_low_mm, checks.rail_high_mm
        floor, gap, motion = checks.loss_floor_mm, checks.rail_gap_mm, checks.repeat_motion_mm
        lags = [lag(p, m, checks.hold_window, checks.still_mm) for p, m in self.rides]
        losses = [np.abs(_mean(log_ratios(p, m, floor), checks.loss_window)) for p, m in self.rides]
        return {
            "rail_steps": max(float(rail_runs(p, m, low, high, gap).max()) for p, m in self.rides),
            "repeat_steps": max(float(repeat_runs(p, m, low, high, motion).max()) for p, m in self.rides),
            "hold_ratio": math.exp(-float(self.peaks(lags).max())),
            "loss_threshold": float(self.peaks(losses).max()),
        }

    def baselines(self, target: float) -> dict[str, Baseline]:
        """What others use, with limits for the whole budget: they make one comparison, not four."""
        plain: dict[str, Baseline] = {
            "persistence": Persistence(PERSISTENCE),
            "cusum": Cusum(math.log1p(target) / 2),  # half of the change to be found, as Page's test wants it
            "residual": Residual(20, 1),
        }
        tuned = {}
        for name, baseline in plain.items():
            figures = [baseline.figure(p, m) for p, m in self.rides]
            level = limit(self.peaks(figures), self.hours, CHECKS * self.per_hour)
            tuned[name] = replace(baseline, limit=min(level, 1e6))
        return tuned

    def _held(self, p: Floats, m: Floats, window: int, level: float, still: float) -> Floats:
        """Seconds until each hold put into a ride is found, EVERY samples at most."""
        noise = np.random.Generator(np.random.PCG64(0)).normal(0.0, NOISE_MM, EVERY)
        out = []
        for start in range(self.begin, len(m) - EVERY, EVERY):
            stretch = slice(start - window, start + EVERY)
            held = m[stretch].copy()
            held[window:] = held[window - 1] + noise
            over = lag(p[stretch], held, window, still)[window:] > level
            out.append((int(over.argmax()) + 1 if over.any() else EVERY) / RATE_HZ)
        return np.array(out)

    def _lost(self, ratio: Floats, window: int, level: float, shift: float) -> Floats:
        """Seconds until each loss of calibration put into a ride is found, EVERY samples at most."""
        out = []
        ramp = shift * np.minimum(np.arange(1, EVERY + 1), window) / window
        mean = _mean(ratio, window)
        for start in range(self.begin, len(ratio) - EVERY, EVERY):
            over = np.abs(mean[start : start + EVERY] + ramp) > level
            out.append((int(over.argmax()) + 1 if over.any() else EVERY) / RATE_HZ)
        return np.array(out)


def lag(predicted: Floats, measured: Floats, window: int, still: float) -> Floats:
    """log of predicted over measured standard deviation in a window; -inf where the prediction is still."""
    p, m = (np.sqrt(np.maximum(spreads(values, window), 0)) for values in (predicted, measured))
    moves = p >= window * still * PER_MM
    moves[: window - 1] = False
    out = np.full(len(p), -np.inf)
    out[moves] = np.log(p[moves] / np.maximum(m[moves], 1.0))
    return out


def _mean(values: Floats, window: int) -> Floats:
    """Mean over the last `window` samples, those before the first counting as zero."""
    total = np.cumsum(np.concatenate([np.zeros(window), values]))
    return (total[window:] - total[:-window]) / window
