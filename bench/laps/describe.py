"""Riding in numbers: how fast the strokes move, at which frequencies, how long after the front the rear.

Belongs here: measures that hold for simulated and recorded laps alike, of one lap or of several pooled. They
are taken on even pieces (`even_pieces`): gaps are left out, not bridged. Never: a table or a plot.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.errors import LapError
from bench.laps.lap import Lap
from bench.laps.steps import GAP, JITTER

STROKES = ("fork_stroke_mm", "rear_stroke_mm")
CLASSES_MM_S = (0.0, 50.0, 100.0, 200.0, 300.0, 400.0, 600.0, 800.0, 1200.0, 2000.0)
"""Edges of the classes of stroke speed, for figure IV.14; the last class is open."""

LIMIT_MM_S = 400.0
"""The share of time below it stands beside the classes."""

SPEEDS_MM_S = np.arange(-5000.0, 5001.0, 50.0)
"""Edges of the speeds' histogram, compression positive; what is beyond counts in the first and the last."""

PERCENTILES = (50.0, 90.0, 99.0, 99.9)

BANDS_HZ = (0.25, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0)
"""Edges of the frequency bands; "all" power is the power from the first to the last."""

RANGE_HZ = (1.0, 10.0)
"""What section IV.2 calls the range of the dampers' vibration."""

SMOOTH_HZ = 50.0
"""Above it a stroke's derivative is the sensor's noise."""

FOLLOW_HZ = 4.0
"""Above it the rear follows the front. Below, the body moves both at once, which hides the delay on recorded
mountain bike rides."""

WINDOW_S = 8.0
"""Of a spectrum."""

GRID_HZ = np.arange(0.0, 200.0 + 0.5 / WINDOW_S, 1.0 / WINDOW_S)
"""Frequencies of every spectrum here, whatever the lap's rate."""

LEAST = 64
"""Samples in a piece: fewer can be neither filtered nor analysed."""

Values = NDArray[np.float64]


def even_pieces(laps: Sequence[Lap]) -> list[Lap]:
    """The stretches between gaps, on even time bases with as many samples; those under LEAST are left out.

    Jitter of more than 1 % of a step is interpolated away, on straight lines. Raises LapError for laps of
    different rates, which cannot be pooled, and if nothing is left.
    """
    rates = [1e9 / float(np.median(np.diff(lap.t_ns))) for lap in laps]
    for lap, rate in zip(laps, rates, strict=True):
        if abs(rate - rates[0]) > JITTER * rates[0]:
            raise LapError(
                f"{lap.source}: sampled at {rate:g} Hz, {laps[0].source} at {rates[0]:g} Hz: not to be pooled"
            )
    pieces = []
    for lap, rate in zip(laps, rates, strict=True):
        cuts = np.flatnonzero(np.diff(lap.t_ns) > GAP * 1e9 / rate) + 1
        stretches = pairwise((0, *cuts.tolist(), len(lap.t_ns)))
        pieces += [_even(lap, start, end) for start, end in stretches if end - start >= LEAST]
    if not pieces:
        names = ", ".join(lap.source for lap in laps)
        raise LapError(f"{names}: nowhere {LEAST} samples without a gap, too few to measure; see --repair")
    return pieces


def _even(lap: Lap, start: int, end: int) -> Lap:
    t_ns = lap.t_ns[start:end] - lap.t_ns[start]
    even_ns = np.rint(np.linspace(0, t_ns[-1], len(t_ns))).astype(np.int64)
    channels = {name: values[start:end] for name, values in lap.channels.items()}
    if np.abs(t_ns - even_ns).max() > JITTER * even_ns[1]:
        channels = {name: np.interp(even_ns, t_ns, values) for name, values in channels.items()}
    return Lap(even_ns, channels, lap.source)


def rate_hz(piece: Lap) -> float:
    """Sample rate of an even piece. Raises LapError for a lap that is none."""
    rate = 1e9 * (len(piece.t_ns) - 1) / piece.duration_ns
    steps = np.diff(piece.t_ns)
    worst = int(np.argmax(np.abs(steps - 1e9 / rate)))
    if abs(steps[worst] - 1e9 / rate) > (GAP - 1.0) * 1e9 / rate:
        raise LapError(
            f"{piece.source}: a step of {steps[worst] / 1e6:g} ms after {piece.t_ns[worst] / 1e9:.9g} s "
            f"where {1e3 / rate:g} ms are usual: not an even time base; see --repair"
        )
    return rate


def resolution(values: Values) -> float:
    """The median difference between neighbouring values that occur: a sensor's code, where there is one."""
    different = np.unique(values)
    return float(np.median(np.diff(different))) if len(different) > 1 else float("nan")


def stroke_speed(piece: Lap, channel: str) -> Values:
    """Speed of a stroke, mm/s float64 (samples,), positive in compression.

    The central difference after a low pass of SMOOTH_HZ, second order, forwards and back, where the rate
    leaves room for one. FIDELITY: at 100 Hz the difference shows 86 % of the speed of a 15 Hz wheel hop.
    Raises LapError for a piece without the channel.
    """
    piece.require((channel,), "the speed of a stroke")
    rate, values = rate_hz(piece), piece.channels[channel]
    if rate > 2.5 * SMOOTH_HZ:
        values = _filtered(values, SMOOTH_HZ, "low", rate)
    speed: Values = np.gradient(values, 1.0 / rate)
    return speed


def _filtered(values: Values, hz: float, kind: str, rate: float) -> Values:
    """Butterworth, second order, forwards and back; as long mirrored at the ends as its answer lasts."""
    from scipy.signal import butter, sosfiltfilt

    length = min(len(values) - 1, round(5.0 * rate / hz))
    filtered: Values = sosfiltfilt(butter(2, hz, kind, fs=rate, output="sos"), values, padlen=length)
    return filtered


def shares(speed: Values) -> Values:
    """Share of samples whose absolute speed (mm/s) lies in each of CLASSES_MM_S, float64 (classes,)."""
    return np.histogram(np.abs(speed), [*CLASSES_MM_S, np.inf])[0] / len(speed)


def spectrum(piece: Lap, values: Values) -> tuple[Values, Values]:
    """Frequencies in Hz and one-sided power density, unit^2/Hz, of `values` on an even piece's time base.

    By Welch, in Hann windows of WINDOW_S; a shorter piece is filled up with zeros.
    """
    from scipy.signal import welch

    rate = rate_hz(piece)
    window = round(WINDOW_S * rate)
    f, density = welch(values, rate, nperseg=min(len(values), window), nfft=window, detrend="linear")
    return f, density


def pooled_spectrum(pieces: Sequence[Lap], channel: str) -> Values:
    """One-sided power density of a channel at GRID_HZ, unit^2/Hz; NaN beyond half the sample rate.

    Pieces shorter than WINDOW_S count only if all are.
    """
    long = [piece for piece in pieces if piece.duration_ns >= WINDOW_S * 1e9] or pieces
    weight = [len(piece.t_ns) for piece in long]
    each = [np.interp(GRID_HZ, *spectrum(p, p.channels[channel]), right=np.nan) for p in long]
    total: Values = np.average(each, axis=0, weights=weight)
    return total


def power(density: Values, low_hz: float, high_hz: float) -> float:
    """Power of a density at GRID_HZ from `low_hz` to below `high_hz`; NaN where the rate does not reach."""
    first, end = np.searchsorted(GRID_HZ, (low_hz, high_hz))
    return float(density[first:end].sum() / WINDOW_S)


def band_powers(density: Values) -> Values:
    """Power in each of BANDS_HZ, float64 (bands,)."""
    return np.array([power(density, low, high) for low, high in pairwise(BANDS_HZ)])


def range_share(density: Values, derivatives: int = 0) -> float:
    """Share of all power that lies in RANGE_HZ: of what `density` is of, or of its n-th derivative."""
    # S_v = (2 pi f)^2 S_x
    derived = density * (2.0 * np.pi * GRID_HZ) ** (2 * derivatives)
    whole = power(derived, BANDS_HZ[0], BANDS_HZ[-1])
    return power(derived, *RANGE_HZ) / whole if whole > 0 else float("nan")


class Motion(NamedTuple):
    """One stroke's motion: speeds in mm/s, shares of 1, the power in each of BANDS_HZ in mm^2.

    compression_p99 and rebound_p99: of the speeds in either direction; NaN if there are none.
    histogram: share of the samples between SPEEDS_MM_S. density: of the stroke, at GRID_HZ, mm^2/Hz.
    speed_in_range and acceleration_in_range: share of the power of the stroke's derivatives in RANGE_HZ.
    NaN where the rate does not reach.
    """

    low_mm: float
    high_mm: float
    std_mm: float
    resolution_mm: float
    percentiles: Values
    fastest: float
    under_limit: float
    classes: Values
    compression_p99: float
    rebound_p99: float
    histogram: Values
    density: Values
    bands: Values
    speed_in_range: float
    acceleration_in_range: float


def motion(pieces: Sequence[Lap], channel: str) -> Motion:
    """Measure a stroke over all pieces. Raises LapError for a piece without it."""
    speed = np.concatenate([stroke_speed(piece, channel) for piece in pieces])
    values = np.concatenate([piece.channels[channel] for piece in pieces])
    density = pooled_spectrum(pieces, channel)
    return Motion(
        float(values.min()),
        float(values.max()),
        float(values.std()),
        resolution(values),
        np.percentile(np.abs(speed), PERCENTILES),
        float(np.abs(speed).max()),
        float(np.mean(np.abs(speed) < LIMIT_MM_S)),
        shares(speed),
        _p99(speed[speed > 0]),
        _p99(-speed[speed < 0]),
        np.histogram(np.clip(speed, *SPEEDS_MM_S[[0, -1]]), SPEEDS_MM_S)[0] / len(speed),
        density,
        band_powers(density),
        range_share(density, 1),
        range_share(density, 2),
    )


def _p99(speed: Values) -> float:
    return float(np.percentile(speed, 99.0)) if len(speed) else float("nan")


class Delay(NamedTuple):
    """How long after the front the rear does the same: median and quartiles of the windows that count, s.

    windows: how many agreed clearly enough to count, of how many. base_m: the median of delay times speed,
    the wheelbase a follower would have; NaN without speed.
    """

    median_s: float
    low_s: float
    high_s: float
    windows: int
    of: int
    base_m: float


def delay(lap: Lap) -> Delay:
    """The delay from fork to rear stroke over one lap; see `pooled_delay`."""
    return pooled_delay(even_pieces([lap]))


def pooled_delay(
    pieces: Sequence[Lap], window_s: float = 5.0, longest_s: float = 1.0, clear: float = 0.3
) -> Delay:
    """The delay from fork to rear stroke by cross-correlation of their speeds above FOLLOW_HZ, in windows.

    Lags from 0 to `longest_s` are looked at, and read between samples. A window counts if its best normalised
    correlation is at least `clear`. NaN if none does. Raises LapError for a piece that lacks a stroke.
    """
    found: list[float] = []
    bases: list[float] = []
    windows = 0
    for piece in pieces:
        rate = rate_hz(piece)
        if rate <= 2.5 * FOLLOW_HZ:
            continue
        front, rear = (_filtered(stroke_speed(piece, name), FOLLOW_HZ, "high", rate) for name in STROKES)
        width, reach = round(window_s * rate), round(longest_s * rate)
        for start in range(0, len(front) - width - reach + 1, width):
            windows += 1
            match = _match(front[start : start + width], rear[start : start + width + reach])
            best = int(np.argmax(match))
            if match[best] < clear:
                continue
            found.append((best + _vertex(match, best)) / rate)
            if "speed_kmh" in piece.channels:
                speed = float(piece.channels["speed_kmh"][start : start + width].mean())
                bases.append(found[-1] * speed / 3.6)
    if not found:
        return Delay(np.nan, np.nan, np.nan, 0, windows, np.nan)
    low, median, high = np.percentile(found, (25, 50, 75))
    base = float(np.median(bases)) if bases else float("nan")
    return Delay(float(median), float(low), float(high), len(found), windows, base)


def _match(front: Values, rear: Values) -> Values:
    """Normalised correlation of `front` with each stretch of `rear` of its length, float64 (lags,)."""
    from scipy.signal import correlate

    a, b = front - front.mean(), rear - rear.mean()
    summed = np.cumsum(np.concatenate([[0.0], b * b]))
    energy = np.dot(a, a) * (summed[len(a) :] - summed[: -len(a)])
    # The small number: of two speeds that are rounding errors nothing follows.
    match: Values = correlate(b, a, mode="valid", method="fft") / np.sqrt(energy + 1e-12)
    return match


def _vertex(match: Values, best: int) -> float:
    """Where the parabola through the best lag and its neighbours is highest, from `best`, in samples."""
    if not 0 < best < len(match) - 1:
        return 0.0
    before, at, after = match[best - 1 : best + 2]
    bend = before - 2.0 * at + after
    return float(0.5 * (before - after) / bend) if bend < 0 else 0.0
