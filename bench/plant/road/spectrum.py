"""What a road's height says of its roughness: smoothed spectrum and fitted line, as ISO 8608 reports them.

Belongs here: measuring a profile, whatever it comes from. Never: making one.

The bands are those of the standard: octaves up to a centre of 0.0312 cycles/m, third-octaves up to 0.25,
twelfth-octaves from 0.2806, all centred on powers of two (checked against the public implementation in
github.com/gislas3/quartercar, which has the same exponents and the same 0.2726 cycles/m as the first edge of
the twelfths).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.errors import RouteError
from bench.plant.road.iso8608 import HIGHEST_PER_M, LOWEST_PER_M, N0_PER_M

_FEWEST = 100  # samples; below that a spectrum says nothing
_BANDS = ((-9, -5, 1), (-13, -6, 3), (-22, 60, 12))
"""First and last centre frequency as an exponent of two times the last column, the bands per octave."""


class Spectrum(NamedTuple):
    """Smoothed one-sided displacement density `density_m3` at the bands' centres `n_per_m` (cycles/m)."""

    n_per_m: NDArray[np.float64]
    density_m3: NDArray[np.float64]


class Line(NamedTuple):
    """The straight line through a spectrum in double logarithm: Gd(n) = level_m3 (n / 0.1)^-waviness."""

    level_m3: float
    waviness: float


def measured(height_m: NDArray[np.float64], step_m: float) -> Spectrum:
    """Spectrum of a profile of evenly spaced heights (samples,), smoothed in the bands of ISO 8608.

    The trend is taken out and a Hann window laid over the whole profile. A band is given where the profile is
    long enough for a line of the raw spectrum within it, and where half the sampling rate is above it.
    Raises RouteError for a profile too short, and for heights that are no finite numbers.
    """
    count = len(height_m)
    if count < _FEWEST:
        raise RouteError(f"a profile of {count} samples has no spectrum; it takes {_FEWEST}")
    if not np.all(np.isfinite(height_m)):
        raise RouteError("a profile with heights that are no finite numbers has no spectrum")
    place = np.arange(count) - 0.5 * (count - 1)
    level = height_m - np.mean(height_m)
    level = level - place * (np.sum(place * level) / np.sum(place * place))
    window = np.hanning(count)
    raw = np.abs(np.fft.rfft(level * window)) ** 2 * (2.0 * step_m / np.sum(window**2))
    resolution = 1.0 / (count * step_m)
    # A line stands for a strip as wide as the resolution; bands share the strips they cut: the cumulated
    # power at the strips' edges makes that an interpolation.
    edges = (np.arange(len(raw) + 1) - 0.5) * resolution
    power = np.concatenate([[0.0], np.cumsum(raw * resolution)])
    low, centre, high = _bands()
    seen = (low >= resolution) & (high <= edges[-2])
    low, centre, high = low[seen], centre[seen], high[seen]
    density = (np.interp(high, edges, power) - np.interp(low, edges, power)) / (high - low)
    return Spectrum(centre, density)


def fitted(spectrum: Spectrum) -> Line:
    """The least-squares line over the bands from 0.011 to 2.83 cycles/m, each band weighing the same.

    Raises RouteError where fewer than two bands hold power.
    """
    n, g = spectrum
    # the last band's centre is 2^1.5 = 2.828
    fit = (n >= LOWEST_PER_M) & (n <= HIGHEST_PER_M) & (g > 0.0)
    if np.count_nonzero(fit) < 2:
        raise RouteError("a flat profile, or one shorter than two bands of ISO 8608, has no roughness")
    x, y = np.log(n[fit] / N0_PER_M), np.log(g[fit])
    x_mean, y_mean = np.mean(x), np.mean(y)
    slope = np.sum((x - x_mean) * (y - y_mean)) / np.sum((x - x_mean) ** 2)
    return Line(float(np.exp(y_mean - slope * x_mean)), float(-slope))


def _bands() -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Lower edge, centre and upper edge of every band, in cycles/m."""
    centres, halves = [], []
    for first, last, parts in _BANDS:
        exponent = np.arange(first, last + 1) / parts
        centres.append(2.0**exponent)
        halves.append(np.full(len(exponent), 2.0 ** (0.5 / parts)))
    centre, half = np.concatenate(centres), np.concatenate(halves)
    return centre / half, centre, centre * half
