"""Gyroscope and accelerometers with a digital output: from the true rate or acceleration to their register.

Belongs here: curve, slope, noise, low-pass, zero level, output rate. Never: a figure, rounding and saturation
(the transducer's), a track or a converter of the logger's.

FIDELITY: no cross-axis sensitivity, no gyroscope that feels acceleration, no vibration rectification. The
register is renewed at the sensor's own rate, but only at instants of the lap.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.sensors.curves import bend, smooth_curve
from bench.sensors.lowpass import lowpass, noise_bandwidth_hz, white
from bench.sensors.parts import Mems
from bench.sensors.streams import Draw
from bench.sensors.transducers import Transducer
from targets.jit import njit

KNOT_S = 1.0  # a random walk and a temperature are straight over a second


def read(
    transducer: Transducer,
    part: Mems,
    t_ns: NDArray[np.int64],
    values: NDArray[np.float64],
    draw: Draw,
) -> NDArray[np.float64]:
    """Codes before rounding, float64 (samples,), of true values; delayed by `lowpass.delay_s`."""
    x = values
    if part.nonlinearity:
        limit = part.nonlinearity * transducer.high
        x = bend(smooth_curve(draw("linearity"), limit, transducer.low, transducer.high, True), x)
    if part.sensitivity:
        x = x * (1.0 + part.sensitivity * draw("sensitivity").standard_normal())
    start, slope = x[0], 0.0
    if part.noise_density:
        density = part.noise_density * part.unit
        # The sensor samples itself at its own rate: above half of that there is nothing.
        widest_hz = noise_bandwidth_hz(part.lowpass_hz, part.lowpass_order)
        if part.odr_hz:
            widest_hz = min(widest_hz, part.odr_hz / 2.0)
        noise = draw("noise")
        if part.lowpass_hz:
            # It has been running before the lap: output and slope are independent and equally wide.
            start, slope = np.array([start, slope]) + (
                density * np.sqrt(widest_hz) * noise.standard_normal(2)
            )
        noisy = white(t_ns, density, part.lowpass_hz, widest_hz, noise)
        noisy += x
        x = noisy
    if part.lowpass_hz:
        x = lowpass(t_ns, x, part.lowpass_hz, part.lowpass_order, start, slope)
    if part.zero_level or part.zero_per_k or part.zero_walk:
        x = _add(t_ns, x, zero_level(part, t_ns[-1] * 1e-9, draw))
    if part.odr_hz:
        x = _register(t_ns, x, part.odr_hz, draw("rate").uniform())
    return transducer.exact(x)


def zero_level(part: Mems, duration_s: float, draw: Draw) -> NDArray[np.float64]:
    """What the sensor says at zero, every KNOT_S from 0 to past `duration_s`, float64, channel's unit.

    What the calibration at standstill left, warming up, and a random walk.
    """
    knots = int(duration_s / KNOT_S) + 2
    t_s = KNOT_S * np.arange(knots)
    warming = part.warming_k * -np.expm1(-t_s / part.warming_s)
    walk = np.zeros(knots)
    walk[1:] = np.cumsum(draw("walk").standard_normal(knots - 1)) * math.sqrt(KNOT_S)
    zero = (
        part.zero_level * draw("zero").standard_normal()
        + part.zero_per_k * draw("temperature").standard_normal() * warming
        + part.zero_walk * walk
    )
    level: NDArray[np.float64] = zero * part.unit
    return level


@njit(cache=True)
def _add(t_ns: Any, x: Any, knots: Any) -> Any:
    out = np.empty_like(x)
    for i in range(len(x)):
        place = t_ns[i] * 1e-9 / KNOT_S
        k = int(place)
        out[i] = x[i] + knots[k] + (place - k) * (knots[k + 1] - knots[k])
    return out


@njit(cache=True)
def _register(t_ns: Any, x: Any, odr_hz: float, phase: float) -> Any:
    """What stands in the register: the sample at which the last conversion ended."""
    out = np.empty_like(x)
    held = x[0]
    count = math.floor(phase)
    for i in range(len(x)):
        now = math.floor(t_ns[i] * 1e-9 * odr_hz + phase)
        if now != count:
            held = x[i]
            count = now
        out[i] = held
    return out
