"""Curves of a predictor's error: REC (III.3) and SOE (III.4), and what is read off them.

Belongs here: distributions of the deviations of some runs. Never: a single figure of a run (`measures.py`), a
plot.

Both are step functions, and exact: no bin, no kernel. What is `errors` here is what `measures.deviations`
returns: one array a run, percent, washout left out. A window never reaches from one run into the next: each
run has its own windows, the first of them ending at its L_s-th sample.
"""

from collections.abc import Sequence
from math import ceil
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from targets.narx.measures import sliding_mean

Floats = NDArray[np.float64]

POINTS = 400
"""Points of a decimated curve, at most: more than a plot's pixels show of a step."""


class Curve(NamedTuple):
    """Points of a step function: from tolerance_percent[k] on it is share[k]; the first tolerance is 0.

    It is constant from each tolerance to the next where no point was left out, and after the last.
    """

    tolerance_percent: Floats
    share: Floats


def rec(errors: Sequence[Floats], points: int = POINTS) -> Curve:
    """Regression error characteristic (III.3): the share of all samples whose error is within the tolerance.

    The empirical distribution function of the errors, P(Er <= tolerance), up to the largest of them, where it
    is 1. Of more samples than `points` that many steps are kept, half of them evenly spaced by samples, half
    by tolerance, so that neither the rise nor the tail gets coarse; each point kept is exact.
    """
    return _distribution(_joined(errors), points)


def soe(errors: Sequence[Floats], samples: int, points: int = POINTS) -> Curve:
    """Sliding occurrence of errors (III.4): the share of windows whose mean error exceeds the tolerance.

    The survivor function P(E_mean,L > tolerance) of the mean over every `samples` (L_s) errors on end; with
    L_s = 1 it is 1 - `rec`. Points are kept as in `rec`.
    Raises ValueError if no run is as long as a window.
    """
    curve = _distribution(_windows(errors, samples), points)
    return Curve(curve.tolerance_percent, 1.0 - curve.share)


def aoc(errors: Sequence[Floats], limit_percent: float | None = None) -> float:
    """Area over the REC curve, in percent: the mean error of all samples.

    limit_percent: where the tolerance axis ends. What a sample errs beyond it then has no area: the area is
    the mean of min(Er, limit), never more than the mean error, and says nothing of how far the tail reaches.
    That is the estimate's bias of section III.3; areas of two curves compare only at one limit.
    """
    values = _joined(errors)
    if limit_percent is None:
        return float(values.mean())
    if not limit_percent > 0.0:
        raise ValueError(f"a tolerance axis that ends at {limit_percent} %")
    return float(np.minimum(values, limit_percent).mean())


def least_of_worst(errors: Sequence[Floats], samples: int, share: float = 0.10) -> float:
    """The smallest E_mean,L among the worst `share` of the windows, percent: where SOE falls through `share`.

    Section III.4 reads it off Figure III.16 for a tenth: 5 % for the NARX network at L = 10 ms. The worst of
    m windows are the share * m largest, rounded up: this is the quantile 1 - share, and where that lies
    between two windows the larger one.
    Raises ValueError for a share outside ]0, 1] and if no run is as long as a window.
    """
    if not 0.0 < share <= 1.0:
        raise ValueError(f"the worst {share} of the windows: a share above 0, at most 1 is needed")
    means = _windows(errors, samples)
    worst = ceil(round(share * means.size, 6))  # 0.07 * 100 is a little more than 7
    return float(np.partition(means, means.size - worst)[means.size - worst])


def _windows(errors: Sequence[Floats], samples: int) -> Floats:
    means = [sliding_mean(run, samples) for run in errors]
    if not any(run.size for run in means):
        raise ValueError(f"no run is as long as a window of {samples} samples")
    return _joined(means)


def _joined(errors: Sequence[Floats]) -> Floats:
    values = [np.asarray(run, dtype=np.float64) for run in errors if len(run)]
    if not values:
        raise ValueError("no error to draw a curve of")
    return np.concatenate(values)


def _distribution(values: Floats, points: int) -> Curve:
    """P(value <= tolerance) of values not below 0, at 0 and at no more than `points` of them."""
    if points < 4:
        raise ValueError(f"a curve of {points} points")
    ordered = np.sort(values)
    n, kept = len(ordered), ordered
    if n > points:
        ranks = np.linspace(0, n - 1, points // 2).astype(np.intp)
        even = np.linspace(ordered[0], ordered[-1], points - points // 2)
        kept = ordered[np.union1d(ranks, np.searchsorted(ordered, even, side="right") - 1)]
    tolerance = np.union1d(0.0, kept)
    return Curve(tolerance, np.searchsorted(ordered, tolerance, side="right") / n)
