"""What is done to channels before a network sees them (sections III.2 and III.3).

Belongs here: plain functions on arrays, each reporting what it changed. Never: a file, a lap, a network.

In this order: `resampled` to the control loop's rate, `edited` of outliers, `shifted`, `normalised`. The
thesis does all four. Ours leaves out the filter of the first, and the second: the network is to see in
training what the ECU will see on the bus, which is sampled and held, bumps included.
"""

from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

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

NORMAL = 1.4826
"""Standard deviation of normal values over their median absolute deviation."""

STOP_DB = 74.0
"""What the anti-aliasing filter leaves of what would alias: 12 bits hold 74 dB, less is under one code."""

PASS = 0.8
"""Share of the new Nyquist frequency up to which the filter changes nothing: 40 of 50 Hz."""


class Resampled(NamedTuple):
    """A channel, or some as columns, at a lower rate.

    values: (T',) or (T', n). dropped: samples fewer than before. removed_rms: rms, by column, of what the
    filter changed in the samples that stayed; 0 without it.
    """

    values: Floats
    dropped: int
    removed_rms: Floats


class Edited(NamedTuple):
    """The runs of a channel without its outliers.

    replaced: how many of all `samples` were outliers. median, deviation: what they were judged by; a
    deviation of 0 judges nothing.
    """

    runs: tuple[Floats, ...]
    replaced: int
    samples: int
    median: float
    deviation: float

    @property
    def share(self) -> float:
        """Share of all samples that were replaced."""
        return self.replaced / self.samples


def resampled(
    values: ArrayLike, rate_hz: float, to_hz: float = 100.0, antialias: bool = False, name: str = "channel"
) -> Resampled:
    """Take a channel (T,), or some as columns (T, n), from rate_hz to to_hz (section III.2: 1 kHz, 100 Hz).

    Sample k of the result is at the time of sample k rate_hz / to_hz. Plainly, it is that sample: what a
    logger that samples and holds puts on the bus, and so what the ECU sees. antialias: a linear-phase
    low-pass goes first (Kaiser window, flat up to PASS of the new Nyquist frequency, STOP_DB down from that
    on), shifted back by its delay: zero phase, which only recorded data can have. Ends are extended by point
    reflection.
    Raises TrainingError for rates whose ratio is not whole, no samples, or values not finite.
    """
    x = np.asarray(values, dtype=np.float64)
    if not (rate_hz > 0.0 and to_hz > 0.0) or rate_hz / to_hz != round(rate_hz / to_hz):
        raise TrainingError(f"{name}: from {rate_hz:g} to {to_hz:g} Hz is not every n-th sample")
    _finite(name, x)
    factor = round(rate_hz / to_hz)
    held = x[::factor]
    taken = held.copy()
    if antialias and factor > 1:
        from scipy.signal import upfirdn

        taps = _lowpass(factor)
        half = len(taps) // 2
        ends = [(half, half), *[(0, 0)] * (x.ndim - 1)]
        longer = np.pad(x, ends, mode="reflect", reflect_type="odd")
        # of the convolution what stands in the middle of the taps, every `factor`-th
        first = 2 * half // factor
        taken = upfirdn(taps, longer, 1, factor, axis=0)[first : first + len(held)]
    return Resampled(taken, len(x) - len(taken), np.sqrt(np.mean((taken - held) ** 2, axis=0)))


def edited(
    runs: Sequence[ArrayLike], sigmas: float = 3.0, scale: float = NORMAL, name: str = "channel"
) -> Edited:
    """Replace outliers in the runs of one channel, (T,) each: the robust 3-sigma edit rule of section III.2.

    A value further than `sigmas` deviations from the median of all runs is one, the deviation being `scale`
    times the median absolute deviation from it; it is replaced by the line between its accepted neighbours in
    its own run. scale: NORMAL makes the deviation that of normal values, as the rule is known; 1 is the
    thesis to the letter. (It cites Bi and Bennett 2003 for the rule, who define the REC curve.) A channel
    that mostly rests has a deviation of 0 and is left alone.
    Raises TrainingError for values not finite, and for a run that is outliers alone.

    The training recipe leaves this off: on a suspension what lies beyond 3 sigma are the bumps, and a
    speed of 0 at a traffic light; neither is an error of measurement.
    """
    given = [np.array(run, dtype=np.float64) for run in runs]
    every = np.concatenate([np.zeros(0), *given])
    _finite(name, every)
    median = float(np.median(every))
    deviation = scale * float(np.median(np.abs(every - median)))
    if deviation == 0.0:
        return Edited(tuple(given), 0, len(every), median, deviation)
    replaced = 0
    for k, run in enumerate(given):
        outlying = np.abs(run - median) > sigmas * deviation
        if not outlying.any():
            continue
        if outlying.all():
            raise TrainingError(
                f"{name}: every sample of run {k} is an outlier, further than {sigmas:g} times "
                f"{deviation:g} from {median:g}"
            )
        t = np.arange(len(run))
        run[outlying] = np.interp(t[outlying], t[~outlying], run[~outlying])
        replaced += int(outlying.sum())
    return Edited(tuple(given), replaced, len(every), median, deviation)


def shifted(u: Floats, y: Floats, samples: int) -> tuple[Floats, Floats]:
    """Pair the inputs u (T, n_u) at t with the output y (T,) at t + samples; both lose `samples` rows.

    Section III.3 shifts the rear stroke by 5 samples, the 50 ms by which the front wheel is ahead.
    Raises TrainingError if nothing would be left.
    """
    if not 0 <= samples < len(y):
        raise TrainingError(f"a shift of {samples} samples in a sequence of {len(y)}")
    return u[: len(u) - samples], y[samples:]


def normalised(values: ArrayLike, span: Range) -> Floats:
    """Map physical `values` so that span = (lo, hi) becomes [-1, 1]; values outside are not clipped."""
    lo, hi = span
    return (np.asarray(values, dtype=np.float64) - lo) * (2.0 / (hi - lo)) - 1.0


def physical(values: ArrayLike, span: Range) -> Floats:
    """Undo `normalised`."""
    lo, hi = span
    return (np.asarray(values, dtype=np.float64) + 1.0) * ((hi - lo) / 2.0) + lo


@cache
def _lowpass(factor: int) -> Floats:
    """Taps (2 m factor + 1,) of the anti-aliasing filter, symmetric, their sum 1."""
    from scipy.signal import firwin, kaiserord

    # frequencies as shares of the old Nyquist frequency; the new one is 1 / factor
    taps, beta = kaiserord(STOP_DB + 2.0, (1.0 - PASS) / factor)  # Kaiser's formula is 1 dB short here
    half = -(-taps // (2 * factor)) * factor
    return firwin(2 * half + 1, (1.0 + PASS) / 2.0 / factor, window=("kaiser", beta))


def _finite(name: str, values: Floats) -> None:
    bad = np.argwhere(~np.isfinite(values))
    if bad.size:
        raise TrainingError(f"{name} is {values[tuple(bad[0])]} at sample {bad[0][0]}")
    if not values.size:
        raise TrainingError(f"{name} has no sample")
