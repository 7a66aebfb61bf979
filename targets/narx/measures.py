"""How well a prediction follows a measured stroke (section III.3)."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

FLOOR_MM = 110.0 / 4095.0
"""One code of the rear stroke's converter: the least stroke an error is divided by.

Equation III.2 has no value where the measured stroke is 0, which a topped-out suspension gives.
"""


def relative_error(predicted: ArrayLike, measured: ArrayLike, floor: float = FLOOR_MM) -> float:
    """Er of equation III.2, in percent: 100 mean(|yp - yt| / |yt|), for arrays of one shape."""
    yp, yt = _pair(predicted, measured)
    return float(100.0 * np.mean(np.abs(yp - yt) / np.maximum(np.abs(yt), floor)))


def rmse(predicted: ArrayLike, measured: ArrayLike) -> float:
    """Root of the mean squared error, in the unit of the arrays (mm for strokes)."""
    yp, yt = _pair(predicted, measured)
    return float(np.sqrt(np.mean((yp - yt) ** 2)))


def best_constant(measured: ArrayLike, floor: float = FLOOR_MM) -> float:
    """Return the constant with the least Er on `measured`: the median weighted by 1 / |yt|."""
    yt = np.sort(np.asarray(measured, dtype=np.float64).ravel())
    share = np.cumsum(1.0 / np.maximum(np.abs(yt), floor))
    return float(yt[np.searchsorted(share, share[-1] / 2.0)])


def skill(predicted: ArrayLike, measured: ArrayLike, reference: ArrayLike | None = None) -> float:
    """1 - Er / Er of the reference: 1 is perfect, 0 no better than the reference, below 0 worse.

    reference: another prediction of the same shape (the half-car model's), or None for the best constant
    known in hindsight, which already scores an Er of a few percent on a motorcycle near its equilibrium.
    """
    if reference is None:
        reference = np.full(np.shape(measured), best_constant(measured))
    return 1.0 - relative_error(predicted, measured) / relative_error(reference, measured)


def _pair(predicted: ArrayLike, measured: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    yp, yt = np.asarray(predicted, dtype=np.float64), np.asarray(measured, dtype=np.float64)
    if yp.shape != yt.shape or not yp.size:
        raise ValueError(f"prediction of shape {yp.shape} against measurements of shape {yt.shape}")
    return yp, yt
