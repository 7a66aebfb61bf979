"""What any study of a detector has to beat: a threshold with persistence, and a two-sided CUSUM.

Both look at the log ratio of measured and predicted stroke, like the second detector's loss check, and only
at design time: no ECU runs them. Each is one figure a sample that is compared with one limit.
"""

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from targets.checks import log_ratios
from targets.detector import Detector, check, within
from targets.errors import CalibrationError
from targets.jit import njit

Floats = NDArray[np.float64]

WHO = "a baseline"


@dataclass(frozen=True)
class Persistence:
    """|log ratio| above `limit` for `samples` on end (debouncing, as ECUs do it)."""

    samples: int = within(1, 10_000)
    limit: float = within(0.0, 1e6, 0.0)
    floor_mm: float = within(1e-3, 1e3, 5.0)

    def __post_init__(self) -> None:
        check(self, WHO)

    def figure(self, predicted: Floats, measured: Floats) -> Floats:
        """The least |log ratio| of the last `samples`, (T,)."""
        return _least(np.abs(log_ratios(predicted, measured, self.floor_mm)), self.samples)


@dataclass(frozen=True)
class Cusum:
    """Page's cumulative sum of the log ratio to either side, less `drift` a sample, above `limit`."""

    drift: float = within(0.0, 1e3)
    limit: float = within(0.0, 1e6, 0.0)
    floor_mm: float = within(1e-3, 1e3, 5.0)

    def __post_init__(self) -> None:
        check(self, WHO)

    def figure(self, predicted: Floats, measured: Floats) -> Floats:
        """The larger of both sums, (T,)."""
        return _cusum(log_ratios(predicted, measured, self.floor_mm), self.drift)


@dataclass(frozen=True)
class Residual:
    """The thesis's detector, its threshold tuned like the others' instead of its n."""

    window: int = within(1, 128)
    multiple: int = within(1, 10_000)
    limit: float = within(0.0, 1e6, 0.0)
    floor_mm: float = within(1e-6, 1e3, 0.1)

    def __post_init__(self) -> None:
        check(self, WHO)

    def figure(self, predicted: Floats, measured: Floats) -> Floats:
        """The least E_mean,L (V.1) of the last n windows, (T,)."""
        from targets.ifd import residual

        detector = Detector(window=self.window, floor_mm=self.floor_mm)
        return _least(residual(predicted, measured, detector), self.multiple * self.window)


Baseline = Persistence | Cusum | Residual
KINDS: dict[str, type[Persistence] | type[Cusum] | type[Residual]] = {
    "persistence": Persistence,
    "cusum": Cusum,
    "residual": Residual,
}


def first_alarm(baseline: Baseline, predicted: Floats, measured: Floats, begin: int) -> int | None:
    """Index of the first sample from `begin` on whose figure is above the limit."""
    over = baseline.figure(predicted, measured)[begin:] > baseline.limit
    return begin + int(over.argmax()) if over.any() else None


def document(baseline: Baseline) -> dict[str, Any]:
    """The settings as plain data."""
    return dict(vars(baseline))


def read(name: str, table: dict[str, Any]) -> Baseline:
    """A baseline from plain data. Raises CalibrationError for what is none."""
    if name not in KINDS:
        raise CalibrationError(f"baseline {name!r} is none of {', '.join(KINDS)}")
    try:
        return KINDS[name](**table)
    except TypeError:  # a setting too many or too few
        known = ", ".join(setting.name for setting in fields(KINDS[name]))
        raise CalibrationError(f"baseline {name} has {', '.join(table) or 'nothing'}, not {known}") from None
    except CalibrationError as error:
        raise CalibrationError(f"baseline {name}: {error}") from None


@njit(cache=True)
def _least(values: Floats, window: int) -> Floats:
    """The least of the last `window` values, those before the first counting as zero."""
    out = np.zeros(len(values))
    queue = np.empty(len(values) + 1, np.int64)  # indices whose values rise from the queue's head to its end
    head = tail = 0
    for t in range(len(values)):
        while tail > head and values[queue[tail - 1]] >= values[t]:
            tail -= 1
        queue[tail] = t
        tail += 1
        if queue[head] <= t - window:
            head += 1
        if t >= window - 1:
            out[t] = values[queue[head]]
    return out


@njit(cache=True)
def _cusum(values: Floats, drift: float) -> Floats:
    out = np.empty(len(values))
    up = down = 0.0
    for t in range(len(values)):
        up = max(0.0, up + values[t] - drift)
        down = max(0.0, down - values[t] - drift)
        out[t] = max(up, down)
    return out
