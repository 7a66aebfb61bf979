"""Characteristics that are not straight: a random smooth curve for each specimen, and bending a signal by it.

Belongs here: a deviation as a table over the measured quantity. Never: whose it is, a unit.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from targets.jit import njit

HARMONICS = 4  # as slow as a worn screw or an uneven film; finer is texture
POINTS = 1025


class Curve(NamedTuple):
    """A deviation over low to high in equal steps, straight between them and constant beyond."""

    low: float
    high: float
    table: NDArray[np.float64]


def smooth_curve(
    random: np.random.Generator,
    limit: float,
    low: float,
    high: float,
    through_middle: bool = False,
    points: int = POINTS,
) -> Curve:
    """A curve through zero at both ends (and the middle), its largest deviation uniform from 0 to `limit`."""
    step = 2 if through_middle else 1
    order = step * np.arange(1, HARMONICS + 1)
    weights = random.standard_normal(HARMONICS) / order**2  # keeps the slope as tame as the deviation
    shape = np.sin(np.pi * np.outer(np.linspace(0.0, 1.0, points), order)) @ weights
    return Curve(low, high, shape * (limit * random.uniform() / np.abs(shape).max()))


def texture(random: np.random.Generator, curve: Curve, peak_to_peak: float) -> Curve:
    """`curve` with an independent deviation at each of its points, uniform within `peak_to_peak`."""
    grains = random.uniform(-0.5, 0.5, len(curve.table))
    return curve._replace(table=curve.table + peak_to_peak * grains)


def bend(curve: Curve, x: NDArray[np.float64]) -> NDArray[np.float64]:
    """`x` float64 (samples,) plus the curve's deviation there."""
    bent: NDArray[np.float64] = _bend(curve.table, curve.low, curve.high, x)
    return bent


@njit(cache=True)
def _bend(table: Any, low: float, high: float, x: Any) -> Any:
    out = np.empty_like(x)
    last = len(table) - 1
    scale = last / (high - low)
    for i in range(len(x)):
        place = min(max((x[i] - low) * scale, 0.0), float(last))
        k = min(int(place), last - 1)
        share = place - k
        out[i] = x[i] + table[k] + share * (table[k + 1] - table[k])
    return out
