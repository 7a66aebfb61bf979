"""How well a prediction follows a measured stroke (chapter III).

Belongs here: single figures, on arrays and on lists of runs. Never: a curve (`curves.py`), a file, a network.

A run is (predicted, measured), arrays of one shape, with no gap in time; no window reaches from one into the
next. Relative figures are in percent.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
Pair = tuple[ArrayLike, ArrayLike]

FLOOR_MM = 110.0 / 4095.0
"""One code of the rear stroke's converter: the least stroke an error is divided by.

Equation III.2 has no value where the measured stroke is 0, which a topped-out suspension gives.
"""


def relative_error(predicted: ArrayLike, measured: ArrayLike, floor: float = FLOOR_MM) -> float:
    """Er of equation III.2, in percent: 100 mean(|yp - yt| / |yt|), for arrays of one shape."""
    return float(np.mean(deviation(predicted, measured, floor)))


def deviation(predicted: ArrayLike, measured: ArrayLike, floor: float = FLOOR_MM) -> Floats:
    """Er of equation III.3 at each sample, in percent: 100 |yp - yt| / |yt|, for arrays of one shape."""
    yp, yt = _pair(predicted, measured)
    return 100.0 * np.abs(yp - yt) / np.maximum(np.abs(yt), floor)


def rmse(predicted: ArrayLike, measured: ArrayLike) -> float:
    """Root of the mean squared error, in the unit of the arrays (mm for strokes)."""
    yp, yt = _pair(predicted, measured)
    return float(np.sqrt(np.mean((yp - yt) ** 2)))


def best_constant(measured: ArrayLike, floor: float = FLOOR_MM) -> float:
    """Return the constant with the least Er on `measured`: the median weighted by 1 / |yt|."""
    yt = np.sort(np.asarray(measured, dtype=np.float64).ravel())
    share = np.cumsum(1.0 / np.maximum(np.abs(yt), floor))
    return float(yt[np.searchsorted(share, share[-1] / 2.0)])


def skill(
    predicted: ArrayLike,
    measured: ArrayLike,
    reference: ArrayLike | None = None,
    floor: float = FLOOR_MM,
) -> float:
    """1 - Er / Er of the reference: 1 is perfect, 0 no better than the reference, below 0 worse.

    reference: another prediction of the same shape (the half-car model's), or None for the best constant
    known in hindsight, which already scores an Er of a few percent on a motorcycle near its equilibrium.
    Against a reference without any error it is 0 for another such prediction, else minus infinity.
    """
    if reference is None:
        reference = np.full(np.shape(measured), best_constant(measured, floor))
    own, other = (relative_error(values, measured, floor) for values in (predicted, reference))
    if other == 0.0:
        return 0.0 if own == 0.0 else -np.inf
    return 1.0 - own / other


def deviations(runs: Iterable[Pair], washout: int = 0, floor: float = FLOOR_MM) -> tuple[Floats, ...]:
    """`deviation` of each run, in percent, its first `washout` samples left out: what the curves are made of.

    Raises ValueError for no run, and for one of unequal lengths, no longer than `washout`, or not finite.
    """
    return tuple(deviation(yp, yt, floor) for yp, yt in _counted(runs, washout))


def sliding_mean(values: ArrayLike, samples: int) -> Floats:
    """Mean of every `samples` values on end, (T - samples + 1,): equation III.4 where it has a whole window.

    Element k is the window that begins at k and ends at i = k + samples - 1; none if T < samples.
    """
    x = np.asarray(values, dtype=np.float64)
    if samples < 1:
        raise ValueError(f"a window of {samples} samples")
    if len(x) < samples:
        return np.zeros(0)
    if samples == 1:
        return x.copy()
    total = np.concatenate([np.zeros(1), np.cumsum(x)])
    means = (total[samples:] - total[:-samples]) / samples
    # a difference of sums may be off by their rounding: below the least value there is, say
    return np.clip(means, x.min(), x.max())


@dataclass(frozen=True)
class Performance:
    """What a predictor does on some runs, washout not counted; percent, mm, seconds.

    er_percent: III.2 over all samples of all runs. run_er_percent: of each run; worst_run: index of the
    largest. worst_second_percent: largest mean of `deviation` over one second on end, found in run
    worst_second_run, beginning worst_second_s after that run's first sample (which is in its washout).
    skill: against the best constant of all runs together. skill_of_reference: against another predictor.
    constant: the best constant itself. samples: how many counted.
    """

    er_percent: float
    run_er_percent: tuple[float, ...]
    worst_run: int
    worst_second_percent: float
    worst_second_run: int
    worst_second_s: float
    rmse: float
    constant: float
    skill: float
    skill_of_reference: float | None
    samples: int


def performance(
    runs: Sequence[Pair],
    rate_hz: float,
    washout: int = 0,
    reference: Sequence[ArrayLike] | None = None,
    floor: float = FLOOR_MM,
) -> Performance:
    """Measure the predictions of `runs`, sampled at `rate_hz`, the first `washout` samples of each left out.

    reference: another predictor's predictions of the same runs, in their order (the half-car model's).
    Raises ValueError as `deviations`, and if no run has a whole second left.
    """
    pairs = _counted(runs, washout)
    errors = [deviation(yp, yt, floor) for yp, yt in pairs]
    window = max(1, round(rate_hz))
    seconds = [(k, sliding_mean(values, window)) for k, values in enumerate(errors)]
    seconds = [(k, means) for k, means in seconds if means.size]
    if not seconds:
        raise ValueError(f"no run has a whole second, {window} samples, beyond a washout of {washout}")
    worst, means = max(seconds, key=lambda item: float(item[1].max()))
    each = tuple(float(values.mean()) for values in errors)
    yp, yt = (np.concatenate(columns) for columns in zip(*pairs, strict=True))
    against = None
    if reference is not None:
        if len(reference) != len(pairs):
            raise ValueError(f"{len(reference)} predictions of the reference for {len(pairs)} runs")
        others = _counted([(other, yt) for other, (_, yt) in zip(reference, runs, strict=True)], washout)
        against = skill(yp, yt, np.concatenate([other for other, _ in others]), floor)
    return Performance(
        er_percent=relative_error(yp, yt, floor),
        run_er_percent=each,
        worst_run=int(np.argmax(each)),
        worst_second_percent=float(means.max()),
        worst_second_run=worst,
        worst_second_s=(washout + int(np.argmax(means))) / rate_hz,
        rmse=rmse(yp, yt),
        constant=best_constant(yt, floor),
        skill=skill(yp, yt, floor=floor),
        skill_of_reference=against,
        samples=yt.size,
    )


def _counted(runs: Iterable[Pair], washout: int) -> list[tuple[Floats, Floats]]:
    """The runs as arrays, without their washout."""
    counted = []
    for k, (predicted, measured) in enumerate(runs):
        yp, yt = _pair(predicted, measured)
        if yt.ndim != 1 or len(yt) <= washout or washout < 0:
            raise ValueError(f"run {k} of shape {yt.shape} with a washout of {washout} samples")
        for name, values in (("prediction", yp), ("measurement", yt)):
            bad = np.flatnonzero(~np.isfinite(values))
            if bad.size:
                raise ValueError(f"run {k}: the {name} is {values[bad[0]]} at sample {bad[0]}")
        counted.append((yp[washout:], yt[washout:]))
    if not counted:
        raise ValueError("no run to measure a prediction on")
    return counted


def _pair(predicted: ArrayLike, measured: ArrayLike) -> tuple[Floats, Floats]:
    yp, yt = np.asarray(predicted, dtype=np.float64), np.asarray(measured, dtype=np.float64)
    if yp.shape != yt.shape or not yp.size:
        raise ValueError(f"prediction of shape {yp.shape} against measurements of shape {yt.shape}")
    return yp, yt
