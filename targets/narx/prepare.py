"""What is done to channels before a network sees them (sections III.2 and III.3).

Belongs here: plain functions on arrays, each reporting what it changed. Never: a file, a lap, a network.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from targets.errors import TrainingError

Floats = NDArray[np.float64]
Range = tuple[float, float]

RANGES: dict[str, Range] = {
    "fork_stroke_mm": (0.0, 150.0),
    "pitch_rate_dps": (-80.0, 80.0),
    "speed_kmh": (0.0, 200.0),
    "rear_stroke_mm": (0.0, 110.0),
}
"""Sensor ranges of section III.3, by which channels are normalised."""


def normalised(values: ArrayLike, span: Range) -> Floats:
    """Map physical `values` so that span = (lo, hi) becomes [-1, 1]; values outside are not clipped."""
    lo, hi = span
    return (np.asarray(values, dtype=np.float64) - lo) * (2.0 / (hi - lo)) - 1.0


def physical(values: ArrayLike, span: Range) -> Floats:
    """Undo `normalised`."""
    lo, hi = span
    return (np.asarray(values, dtype=np.float64) + 1.0) * ((hi - lo) / 2.0) + lo


def shifted(u: Floats, y: Floats, samples: int) -> tuple[Floats, Floats]:
    """Pair the inputs u (T, n_u) at t with the output y (T,) at t + samples; both lose `samples` rows.

    Section III.3 shifts the rear stroke by 5 samples, the 50 ms by which the front wheel is ahead.
    Raises TrainingError if nothing would be left.
    """
    if not 0 <= samples < len(y):
        raise TrainingError(f"a shift of {samples} samples in a sequence of {len(y)}")
    return u[: len(u) - samples], y[samples:]


def edit_outliers(values: Floats, sigmas: float = 3.0) -> tuple[Floats, float]:
    """Replace outliers of a channel by the robust 3-sigma edit rule of section III.2.

    A value further than `sigmas` standard deviations from the median is one, the deviation being 1.4826
    times the median absolute deviation; it is replaced by the line between its accepted neighbours.
    Returns the edited copy (T,) and the share of values replaced. A channel that mostly rests has no
    such deviation and is left alone.

    The training recipe leaves this off: on a suspension what lies beyond 3 sigma are the bumps, and a
    speed of 0 at a traffic light; neither is an error of measurement.
    """
    median = np.median(values)
    deviation = 1.4826 * np.median(np.abs(values - median))  # 1.4826: equals sigma for normal values
    outlying = np.abs(values - median) > sigmas * deviation
    if deviation == 0.0 or not outlying.any():
        return values.copy(), 0.0
    t = np.arange(len(values))
    edited = values.copy()
    edited[outlying] = np.interp(t[outlying], t[~outlying], values[~outlying])
    return edited, float(outlying.mean())
