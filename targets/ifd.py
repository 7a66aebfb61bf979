"""The IFD scheme of section V.1 at design time: residual and decision on plain arrays, float64.

The firmware's `core/ifd.c` does the same one step at a time, in single precision.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from targets.calibration import Detector

Floats = NDArray[np.float64]


def residual(predicted: ArrayLike, measured: ArrayLike, detector: Detector) -> Floats:
    """E_mean,L (V.1): |y_p - y_m| / |y_m| averaged over the last L_s samples; relative, (T,).

    predicted, measured: mm (T,). Before the first sample the deviation counts as zero; measured values
    smaller than `floor_mm` divide as that.
    """
    y_p, y_m = np.asarray(predicted, dtype=np.float64), np.asarray(measured, dtype=np.float64)
    deviation = np.abs(y_p - y_m) / np.maximum(np.abs(y_m), detector.floor_mm)
    total = np.cumsum(np.concatenate([np.zeros(detector.window), deviation]))
    return (total[detector.window :] - total[: -detector.window]) / detector.window


def above(values: ArrayLike, detector: Detector) -> NDArray[np.int64]:
    """For how many samples on end the residual has been above T, warm-up not counted; int64 (T,)."""
    over = np.asarray(values) > detector.threshold
    over[: detector.warmup] = False
    index = np.arange(1, len(over) + 1)
    return index - np.maximum.accumulate(np.where(over, 0, index))


def alarms(values: ArrayLike, detector: Detector) -> NDArray[np.bool_]:
    """Where the alarm is up: above T for n windows on end (Figure V.8); bool (T,)."""
    return above(values, detector) >= detector.multiple * detector.window


def quiet_multiple(residuals: list[Floats], detector: Detector) -> int:
    """The smallest n with which none of these fault-free residuals would have raised an alarm."""
    longest = max((int(above(values, detector).max(initial=0)) for values in residuals), default=0)
    return longest // detector.window + 1
