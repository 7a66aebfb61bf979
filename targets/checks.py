"""The second detector at design time: the same checks as `firmware/core/checks.c`, over whole rides at once.

The firmware takes one sample at a time in single precision; here a compiled loop takes a ride in double.
Windows slide over the same integers, so that both agree but for a unit in the last place of one sample.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from targets.detector import Checks
from targets.jit import njit

Floats = NDArray[np.float64]

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
    found = Findings(np.zeros(len(p), np.bool_), np.zeros(len(p), np.int8), np.zeros(len(p)))
    _follow(p, m, checks.warmup, *_settings(checks), False, *found)
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
    found = Findings(np.zeros(len(p), np.bool_), np.zeros(len(p), np.int8), np.zeros(len(p)))
    quiet = max(begin, checks.warmup) - start
    at = _follow(p, m, quiet, *_settings(checks), True, *found)
    return (None, KINDS[NONE]) if at < 0 else (start + at, KINDS[found.kind[at]])


def _pair(predicted: ArrayLike, measured: ArrayLike) -> tuple[Floats, Floats]:
    return np.asarray(predicted, dtype=np.float64), np.asarray(measured, dtype=np.float64)


def _settings(c: Checks) -> tuple[float, ...]:
    return (
        c.rail_steps,
        c.repeat_steps,
        c.hold_window,
        c.loss_window,
        c.heal_steps,
        c.rail_low_mm,
        c.rail_high_mm,
        c.rail_gap_mm,
        c.repeat_motion_mm,
        c.hold_ratio,
        c.still_mm,
        c.loss_threshold,
        c.loss_floor_mm,
    )


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
def scatters(values: Floats, window: int) -> Floats:
    """Return n times the standard deviation over the last `window` samples in integer units; -1 before."""
    out = np.full(len(values), -1.0)
    total = squares = 0
    for t in range(len(values)):
        new = quantised(values[t])
        total += new
        squares += new * new
        if t >= window:
            old = quantised(values[t - window])
            total -= old
            squares -= old * old
        if t >= window - 1:
            out[t] = np.sqrt(float(window * squares - total * total))
    return out


@njit(cache=True)
def rail_runs(predicted: Floats, measured: Floats, low: float, high: float, gap: float) -> NDArray[np.int64]:
    """For how many samples on end a rail has been measured that the prediction is off, (T,)."""
    out = np.zeros(len(measured), np.int64)
    top = bottom = 0
    for t in range(len(out)):
        top = top + 1 if measured[t] >= high and predicted[t] < high - gap else 0
        bottom = bottom + 1 if measured[t] <= low and predicted[t] > low + gap else 0
        out[t] = max(top, bottom)
    return out


@njit(cache=True)
def repeat_runs(
    predicted: Floats, measured: Floats, low: float, high: float, motion: float
) -> NDArray[np.int64]:
    """For how many samples on end the value before has been repeated while the prediction moved, (T,)."""
    out = np.zeros(len(measured), np.int64)
    repeats, last, least, most = 0, 0.0, 0.0, 0.0
    for t in range(len(out)):
        if measured[t] == last and low < measured[t] < high:
            repeats += 1
            least, most = min(least, predicted[t]), max(most, predicted[t])
        else:
            repeats, least, most = 0, predicted[t], predicted[t]
        last = measured[t]
        out[t] = repeats if most - least >= motion else 0
    return out


@njit(cache=True)
def _follow(
    predicted: Floats, measured: Floats, quiet_until: int,
    rail_steps: int, repeat_steps: int, hold_window: int, loss_window: int, heal_steps: int,
    rail_low: float, rail_high: float, rail_gap: float, repeat_motion: float,
    hold_ratio: float, still: float, threshold: float, floor: float,
    stop_at_first: bool, alarms: NDArray[np.bool_], kinds: NDArray[np.int8], losses: Floats,
) -> int:  # fmt: skip
    """Fill alarms, kinds, losses; the first alarm's index, -1 for none. None before quiet_until."""
    steps = len(measured)
    logs = np.zeros(loss_window, np.int64)
    old_m, old_p = np.zeros(hold_window, np.int64), np.zeros(hold_window, np.int64)
    loss_sum = sum_m = sum_p = squares_m = squares_p = 0
    top = bottom = repeats = heal = 0
    last = least = most = 0.0
    alarm, kind, first = False, NONE, -1
    for t in range(steps):
        p, m = predicted[t], measured[t]
        at_top, at_bottom = m >= rail_high, m <= rail_low
        top = top + 1 if at_top and p < rail_high - rail_gap else 0
        bottom = bottom + 1 if at_bottom and p > rail_low + rail_gap else 0
        if m == last and not at_top and not at_bottom:
            repeats += 1
            least, most = min(least, p), max(most, p)
        else:
            repeats, least, most = 0, p, p
        last = m

        h = t % hold_window
        qm, qp = quantised(m), quantised(p)
        sum_m += qm - old_m[h]
        sum_p += qp - old_p[h]
        squares_m += qm * qm - old_m[h] * old_m[h]
        squares_p += qp * qp - old_p[h] * old_p[h]
        old_m[h], old_p[h] = qm, qp

        k = t % loss_window
        r = int(log_ratio(m, p, floor) * ONE)
        loss_sum += r - logs[k]
        logs[k] = r
        mean = abs(loss_sum / (ONE * loss_window))
        losses[t] = mean
        if t < quiet_until:
            continue

        n = hold_window
        scatter_m = n * squares_m - sum_m * sum_m
        scatter_p = n * squares_p - sum_p * sum_p
        moves = t >= n - 1 and scatter_p >= (n * still * PER_MM) ** 2
        found = NONE
        if top >= rail_steps:
            found = OPEN
        elif bottom >= rail_steps:
            found = SHORT
        elif (repeats >= repeat_steps and most - least >= repeat_motion) or (
            moves and scatter_m < hold_ratio * hold_ratio * scatter_p
        ):
            found = HOLD
        elif mean > threshold:
            found = HOLD if moves and scatter_m < scatter_p // 4 else UNCALIBRATION
        if found != NONE:
            if not alarm:
                kind = found
                if first < 0:
                    first = t
            alarm, heal = True, 0
        elif alarm:
            heal += 1
            if heal >= heal_steps:
                alarm, kind = False, NONE
        alarms[t], kinds[t] = alarm, kind
        if stop_at_first and first >= 0:
            return first
    return first
