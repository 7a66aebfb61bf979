"""The second detector at design time: the same checks as `firmware/core/checks.c`, over whole rides at once.

The firmware takes one sample at a time in single precision; here a compiled loop takes a ride in double.
Windows slide over the same integers, so that both agree but for a unit in the last place of one sample.
"""

from collections import namedtuple
from dataclasses import fields
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from targets.detector import Checks
from targets.jit import njit

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

KINDS = ("none", "open", "short", "hold", "uncalibration")
"""What an alarm can name; the index is the number on the bus (IFD_STATUS.kind)."""
NONE, OPEN, SHORT, HOLD, UNCALIBRATION = range(5)

ONE, PER_MM, MOST_MM, MOST_Z = 1048576.0, 200.0, 163.0, 0.15
"""Units of the integers and where they are cut off, as in checks.c."""


class Findings(NamedTuple):
    """What the checks say of a ride, a value a sample: bool (T,), int8 (T,) index into KINDS, float (T,)."""

    alarm: NDArray[np.bool_]
    kind: NDArray[np.int8]
    loss: Floats


def findings(predicted: ArrayLike, measured: ArrayLike, checks: Checks) -> Findings:
    """Run the checks over a ride of predicted and measured strokes, mm (T,), from switching on."""
    p, m = _pair(predicted, measured)
    found = _nothing(len(p))
    _follow(p, m, checks.warmup, _numbers(checks), False, *found)
    return found


def first_alarm(
    predicted: ArrayLike, measured: ArrayLike, begin: int, checks: Checks
) -> tuple[int | None, str]:
    """Index of the first alarm in a ride that is looked at from `begin` on, and the kind it names.

    The checks have been running since as long before as their windows remember.
    """
    p, m = _pair(predicted, measured)
    start = max(
        0, begin - max(checks.loss_window, checks.hold_window, checks.repeat_steps + 1, checks.rail_steps)
    )
    p, m = p[start:], m[start:]
    found = _nothing(len(p))
    at = _follow(p, m, max(begin, checks.warmup) - start, _numbers(checks), True, *found)
    return (None, KINDS[NONE]) if at < 0 else (start + at, KINDS[found.kind[at]])


def _pair(predicted: ArrayLike, measured: ArrayLike) -> tuple[Floats, Floats]:
    return np.asarray(predicted, dtype=np.float64), np.asarray(measured, dtype=np.float64)


def _nothing(steps: int) -> Findings:
    return Findings(np.zeros(steps, np.bool_), np.zeros(steps, np.int8), np.zeros(steps))


_NAMES = tuple(field.name for field in fields(Checks) if field.name not in ("feedback", "warmup"))
_Numbers = namedtuple("_Numbers", _NAMES)  # type: ignore[misc]  # a kernel takes no dataclass


def _numbers(checks: Checks) -> _Numbers:
    return _Numbers(*(getattr(checks, name) for name in _NAMES))


@njit(cache=True)
def log_ratio(measured: float, predicted: float, floor: float) -> float:
    """log(measured / predicted) = 2 atanh z, by three terms of its series; |z| is cut off at MOST_Z."""
    a, b = max(measured, floor), max(predicted, floor)
    z = min(max((a - b) / (a + b), -MOST_Z), MOST_Z)
    s = z * z
    return 2.0 * z * (1.0 + s * (1.0 / 3.0 + s * 0.2))


@njit(cache=True)
def quantised(mm: float) -> int:
    """The motion check's integer of a stroke."""
    return int(min(max(mm, 0.0), MOST_MM) * PER_MM + 0.5)


@njit(cache=True)
def log_ratios(predicted: Floats, measured: Floats, floor: float) -> Floats:
    """Log ratio of every sample, (T,)."""
    out = np.empty(len(measured))
    for t in range(len(out)):
        out[t] = log_ratio(measured[t], predicted[t], floor)
    return out


@njit(cache=True)
def _windowed(values: Floats, t: int, window: int, total: int, squares: int) -> tuple[int, int]:
    """Sum and sum of squares of the last `window` samples, from those of the sample before."""
    new = quantised(values[t])
    old = quantised(values[t - window]) if t >= window else 0
    return total + new - old, squares + new * new - old * old


@njit(cache=True)
def spreads(values: Floats, window: int) -> Integers:
    """n^2 times the variance over the last n = `window` samples, in integer units, exact; -1 before."""
    out = np.full(len(values), -1, np.int64)
    total = squares = 0
    for t in range(len(values)):
        total, squares = _windowed(values, t, window, total, squares)
        if t >= window - 1:
            out[t] = window * squares - total * total
    return out


@njit(cache=True)
def _railed(
    p: float, m: float, low: float, high: float, gap: float, top: int, bottom: int
) -> tuple[int, int]:
    """For how many samples on end a rail has been measured that the prediction is off, from those before.

    A suspension at its stop is at the rail, too: what the model expects there does not count.
    """
    return (
        top + 1 if m >= high and p < high - gap else 0,
        bottom + 1 if m <= low and p > low + gap else 0,
    )


@njit(cache=True)
def rail_runs(predicted: Floats, measured: Floats, low: float, high: float, gap: float) -> Integers:
    """For how many samples on end a rail, either, has been measured that the prediction is off, (T,)."""
    out = np.zeros(len(measured), np.int64)
    top = bottom = 0
    for t in range(len(out)):
        top, bottom = _railed(predicted[t], measured[t], low, high, gap, top, bottom)
        out[t] = max(top, bottom)
    return out


@njit(cache=True)
def _repeated(
    p: float, m: float, last: float, low: float, high: float, repeats: int, least: float, most: float
) -> tuple[int, float, float]:
    """For how many samples on end a value has been repeated, and the prediction's extremes since then."""
    if m == last and low < m < high:
        return repeats + 1, min(least, p), max(most, p)
    return 0, p, p


@njit(cache=True)
def repeat_runs(predicted: Floats, measured: Floats, low: float, high: float, motion: float) -> Integers:
    """For how many samples on end the value before has been repeated while the prediction moved, (T,)."""
    out = np.zeros(len(measured), np.int64)
    repeats, last, least, most = 0, 0.0, 0.0, 0.0
    for t in range(len(out)):
        p, m = predicted[t], measured[t]
        repeats, least, most = _repeated(p, m, last, low, high, repeats, least, most)
        last = m
        out[t] = repeats if most - least >= motion else 0
    return out


@njit(cache=True)
def _found(
    top: int, bottom: int, repeats: int, motion: float, spread_m: int, spread_p: int, loss: float, c: Any
) -> int:
    """What the checks find in a sample, the surest first; spreads are -1 before their window is full."""
    if top >= c.rail_steps:
        return OPEN
    if bottom >= c.rail_steps:
        return SHORT
    if repeats >= c.repeat_steps and motion >= c.repeat_motion_mm:
        return HOLD
    moves = spread_p >= (c.hold_window * c.still_mm * PER_MM) ** 2
    if moves and spread_m < c.hold_ratio * c.hold_ratio * spread_p:
        return HOLD
    if not loss > c.loss_threshold:
        return NONE
    # A held stroke off the mean is soon far off on average, too: it moves less than half of what it should.
    return HOLD if moves and spread_m < spread_p // 4 else UNCALIBRATION


@njit(cache=True)
def _follow(
    predicted: Floats, measured: Floats, quiet_until: int, c: Any, stop_at_first: bool,
    alarms: NDArray[np.bool_], kinds: NDArray[np.int8], losses: Floats,
) -> int:  # fmt: skip
    """Fill alarms, kinds, losses; the first alarm's index, -1 for none. None before quiet_until."""
    logs = np.zeros(c.loss_window, np.int64)
    n, loss_sum = c.hold_window, 0
    sum_m = sum_p = squares_m = squares_p = 0
    top = bottom = repeats = heal = 0
    last = least = most = 0.0
    alarm, kind, first = False, NONE, -1
    for t in range(len(measured)):
        p, m = predicted[t], measured[t]
        top, bottom = _railed(p, m, c.rail_low_mm, c.rail_high_mm, c.rail_gap_mm, top, bottom)
        repeats, least, most = _repeated(p, m, last, c.rail_low_mm, c.rail_high_mm, repeats, least, most)
        last = m
        sum_m, squares_m = _windowed(measured, t, n, sum_m, squares_m)
        sum_p, squares_p = _windowed(predicted, t, n, sum_p, squares_p)
        k = t % c.loss_window
        r = int(log_ratio(m, p, c.loss_floor_mm) * ONE)
        loss_sum += r - logs[k]
        logs[k] = r
        losses[t] = abs(loss_sum / (ONE * c.loss_window))
        if t < quiet_until:
            continue
        full = t >= n - 1
        spread_m = n * squares_m - sum_m * sum_m if full else -1
        spread_p = n * squares_p - sum_p * sum_p if full else -1
        found = _found(top, bottom, repeats, most - least, spread_m, spread_p, losses[t], c)
        if found != NONE:
            if not alarm:
                kind = found
                if first < 0:
                    first = t
            alarm, heal = True, 0
        elif alarm:
            heal += 1
            if heal >= c.heal_steps:
                alarm, kind = False, NONE
        alarms[t], kinds[t] = alarm, kind
        if stop_at_first and first >= 0:
            return first
    return first
