"""The stroke potentiometers: from a stroke in millimetres to what the logger's converter makes of it.

Belongs here: track, slider, supply and converter. Never: a figure, a digital sensor, rounding and saturation
(the transducer's).

Slider's play, the track's curve and texture, the anti-alias low-pass, the converter with its reference. The
deviation of the supply cancels as far as the reference follows it: the code is slider ratio times supply over
reference.
FIDELITY: the ripple of a supply that the reference does not follow enters behind the low-pass. What the
logger's two-point calibration takes out (offset and gain, of track and converter) is left out.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.sensors.curves import bend, smooth_curve, texture
from bench.sensors.lowpass import lowpass
from bench.sensors.parts import Logger, Potentiometer
from bench.sensors.streams import Draw
from bench.sensors.transducers import Transducer
from targets.jit import njit


def read(
    transducer: Transducer,
    part: Potentiometer,
    logger: Logger | None,
    t_ns: NDArray[np.int64],
    stroke_mm: NDArray[np.float64],
    draw: Draw,
) -> NDArray[np.float64]:
    """Codes before rounding, float64 (samples,), of true strokes; delayed by `lowpass.delay_s`."""
    x = stroke_mm
    span = transducer.high - transducer.low
    if part.hysteresis_mm:
        x = _play(x, part.hysteresis_mm / 2.0)
    if part.linearity or part.smoothness:
        points = max(round(span / part.grain_mm), 1) + 1
        track = smooth_curve(
            draw("linearity"), part.linearity * span, transducer.low, transducer.high, points=points
        )
        x = bend(texture(draw("smoothness"), track, part.smoothness * span), x)
    if part.lowpass_hz:
        x = lowpass(t_ns, x, part.lowpass_hz, part.lowpass_order, x[0], 0.0)
    exact = transducer.exact(x)
    return exact if logger is None else _convert(transducer, logger, t_ns, exact, draw)


def _convert(
    transducer: Transducer, logger: Logger, t_ns: NDArray[np.int64], exact: NDArray[np.float64], draw: Draw
) -> NDArray[np.float64]:
    gain = supply_over_reference(logger, t_ns, draw)
    codes = exact - transducer.code_min
    codes *= gain
    codes += transducer.code_min
    if logger.inl_lsb:
        codes = bend(
            smooth_curve(draw("inl"), logger.inl_lsb, transducer.code_min, transducer.code_max), codes
        )
    if logger.noise_lsb:
        noise = draw("converter").standard_normal(len(codes))
        noise *= logger.noise_lsb
        codes += noise
    return codes


def supply_over_reference(logger: Logger, t_ns: NDArray[np.int64], draw: Draw) -> float | NDArray[np.float64]:
    """Sensor's supply over converter's reference, 1 if they are alike: a number or float64 (samples,)."""
    mismatch = logger.reference_mismatch * draw("reference").standard_normal()
    if logger.reference_follows == 1.0:  # both deviate alike: exactly cancelled
        return 1.0 / (1.0 + mismatch)
    random = draw("supply")
    deviation = logger.supply_tolerance * random.uniform(-1.0, 1.0)
    turns = logger.ripple_hz * 1e-9 * t_ns + random.uniform()
    deviation = deviation + logger.supply_ripple * np.sin(2.0 * np.pi * turns)
    return (1.0 + deviation) / ((1.0 + logger.reference_follows * deviation) * (1.0 + mismatch))


@njit(cache=True)
def _play(x: Any, half: float) -> Any:
    """The slider follows its rod once the play of 2 `half` between them is used up."""
    out = np.empty_like(x)
    y = x[0]
    for i in range(len(x)):
        y = min(max(y, x[i] - half), x[i] + half)
        out[i] = y
    return out
