"""ISO 8608: the spectrum of a road's height, its classes A to H, and roads drawn from it.

Belongs here: the law, the class limits, the synthesis. Never: which road has which class, nor how it
is measured.

Displacement density, one-sided, over spatial frequency n: Gd(n) = Gd(n0) (n / n0)^-w, n0 = 0.1 cycles/m.
"""

import math

import numpy as np
from numpy.typing import NDArray

from bench.plant.road.grid import LONGEST_WAVE_M

N0_PER_M = 0.1  # reference spatial frequency
LOWEST_PER_M, HIGHEST_PER_M = 0.011, 2.83  # cycles/m, the range of the standard
WAVINESS = 2.0  # that of the classes
LEVELS_M3 = {letter: 16e-6 * 4.0**k for k, letter in enumerate("ABCDEFGH")}
"""Geometric mean of Gd(n0) of each class; a class reaches a factor of two to either side."""


def limits(level_m3: float) -> tuple[float, float]:
    """Lower and upper Gd(n0) of the class with geometric mean `level_m3`, in m3."""
    return level_m3 / 2.0, level_m3 * 2.0


def class_of(level_m3: float) -> str:
    """Letter of the class in which a road of Gd(n0) = `level_m3` lies; A is open below, H above."""
    for letter, mean in LEVELS_M3.items():
        if level_m3 <= limits(mean)[1]:
            return letter
    return "H"


def density(n_per_m: NDArray[np.float64], level_m3: float, waviness: float) -> NDArray[np.float64]:
    """Gd(n) in m3, any shape, for spatial frequencies above zero in cycles/m."""
    return level_m3 * (n_per_m / N0_PER_M) ** -waviness


def synthesise(
    level_m3: float, waviness: float, count: int, step_m: float, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Draw the height in metres of `count` samples, `step_m` apart, of a road of Gd(n0) = `level_m3`.

    Spectral synthesis: every harmonic of the stretch from the longest wave to half the sampling rate gets a
    complex Gaussian amplitude of the variance the law asks for. The stretch is thereby one period of a
    periodic road, and, started at zero, a bridge: its sample `count`, the first of the next stretch, is zero
    again, so that stretches join without a step. The longest wave is LONGEST_WAVE_M or the stretch.
    """
    length_m = count * step_m
    harmonic = np.arange(math.ceil(length_m / LONGEST_WAVE_M), (count - 1) // 2 + 1)
    harmonic = harmonic[harmonic > 0]
    # G(n) dn is half the square of a wave's amplitude; irfft divides by count and sums both halves
    n = harmonic / length_m
    # (n / n0)^(-w / 2): for w = 2 an exact division, the same bits on every machine
    scale = math.sqrt(level_m3 / (4.0 * step_m) * count) * (n / N0_PER_M) ** (-waviness / 2.0)
    draw = rng.standard_normal((2, len(n)))
    spectrum = np.zeros(count // 2 + 1, dtype=complex)
    spectrum[harmonic] = scale * (draw[0] + 1j * draw[1])
    height = np.fft.irfft(spectrum, count)
    return height - height[0]
