"""The low-pass in a sensor or in front of a converter, on any time base; and the white noise it lets through.

Belongs here: filtering in continuous units of time, and how much noise a step holds. Never: which sensor has
which cut-off, a code.

A Butterworth low-pass of first or second order by the trapezoidal rule, pre-warped for each step. On a
regular time base that is the filter which `scipy.signal.butter` designs by the bilinear transform, -3 dB at
the cut-off. On an irregular one each step is taken with its own length; none is refused.
FIDELITY: a cut-off above 0.45 of the sample rate damps and delays nothing.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from targets.jit import njit

SETTLED = 0.45
"""After a step longer than this share of the cut-off's period the filter has settled: the sample passes."""


def delay_s(lowpass_hz: float, order: int, step_s: float = 0.0) -> float:
    """Delay of slow signals, seconds: 1 / w_c for order 1, sqrt(2) / w_c for order 2.

    With `step_s` that of the filter as it is modelled at this step, where w_c = 2 / step tan(pi f_c step).
    """
    if lowpass_hz == 0.0 or step_s * lowpass_hz >= SETTLED:
        return 0.0
    numerator = 1.0 if order == 1 else math.sqrt(2.0)
    if step_s == 0.0:
        return numerator / (2.0 * math.pi * lowpass_hz)
    return numerator * step_s / (2.0 * math.tan(math.pi * lowpass_hz * step_s))


def noise_bandwidth_hz(lowpass_hz: float, order: int) -> float:
    """The width of a rectangle that lets through as much white noise; infinite without a low-pass."""
    if lowpass_hz == 0.0:
        return math.inf
    return lowpass_hz * (math.pi / 2.0 if order == 1 else math.pi / (2.0 * math.sqrt(2.0)))


@njit(cache=True)
def lowpass(t_ns: Any, u: Any, lowpass_hz: float, order: int, start: float, slope: float) -> Any:
    """Low-pass `u` float64 (samples,) at `t_ns` int64 (samples,) into float64 (samples,).

    start: the first output. slope: its derivative over w_c. u[0] and 0 are a settled filter.
    """
    out = np.empty_like(u)
    y, z = start, slope  # z = y' / w_c
    out[0] = y
    last_ns = 0
    settled = False
    k = 0.0
    damping = math.sqrt(2.0)
    for i in range(1, len(u)):
        step_ns = t_ns[i] - t_ns[i - 1]
        if step_ns != last_ns:
            last_ns = step_ns
            turns = lowpass_hz * step_ns * 1e-9
            settled = turns >= SETTLED
            k = 0.0 if settled else math.tan(math.pi * turns)
        if settled:
            y, z = u[i], 0.0
        elif order == 1:
            # (1 + k) y+ = (1 - k) y + k (u + u+)
            y = ((1.0 - k) * y + k * (u[i - 1] + u[i])) / (1.0 + k)
        else:
            # (I - k A) x+ = (I + k A) x + k B (u + u+),  A = [0 1; -1 -sqrt(2)],  B = [0; 1]
            first = y + k * z
            second = z - k * (y + damping * z) + k * (u[i - 1] + u[i])
            share = 1.0 / (1.0 + k * (damping + k))
            y = ((1.0 + damping * k) * first + k * second) * share
            z = (second - k * first) * share
        out[i] = y
    return out


@njit(cache=True)
def scale_noise(t_ns: Any, normals: Any, density: float, lowpass_hz: float, widest_hz: float) -> None:
    """Turn standard `normals` float64 (samples,) in place into white noise of one-sided `density`.

    White up to half the sample rate where the low-pass comes after it. Where that settles within the step the
    noise of all its bandwidth, `widest_hz`, folds into the sample.
    """
    last_ns = 0
    sigma = 0.0
    for i in range(len(normals)):
        step_ns = t_ns[max(i, 1)] - t_ns[max(i, 1) - 1]
        if step_ns != last_ns:
            last_ns = step_ns
            width = 0.5e9 / step_ns
            if lowpass_hz * step_ns * 1e-9 >= SETTLED or lowpass_hz == 0.0:
                width = widest_hz if widest_hz < math.inf else width
            sigma = density * math.sqrt(width)
        normals[i] *= sigma


def white(
    t_ns: NDArray[np.int64],
    density: float,
    lowpass_hz: float,
    widest_hz: float,
    random: np.random.Generator,
) -> NDArray[np.float64]:
    """White noise float64 (samples,) of one-sided `density` per sqrt(Hz), to be added before `lowpass`."""
    noise = random.standard_normal(len(t_ns))
    scale_noise(t_ns, noise, density, lowpass_hz, widest_hz)
    return noise
