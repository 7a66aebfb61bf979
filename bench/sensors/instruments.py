"""A true signal through the instrument that measures it.

Belongs here: which model reads which part. Never: what a model does, a lap. Apart from `codes`, because the
models need numba and ideal sensors do not.
"""

import numpy as np
from numpy.typing import NDArray

from bench.sensors import encoder, mems, potentiometer
from bench.sensors.parts import Encoder, Mems, Potentiometer, Sensors
from bench.sensors.streams import Draw
from bench.sensors.transducers import Transducer


def read(
    transducer: Transducer,
    sensors: Sensors,
    t_ns: NDArray[np.int64],
    values: NDArray[np.float64],
    draw: Draw,
) -> tuple[NDArray[np.int32], int]:
    """Codes int32 (samples,) of true `values` at `t_ns` as `sensors` measure them, and how many saturated."""
    # FIDELITY: every front end saturates a span beyond its span, so that a wild value does not ring for
    # seconds in the low-pass, nor turn the wheel by kilometres.
    span = transducer.high - transducer.low
    values = np.clip(values, transducer.low - span, transducer.high + span)
    part = sensors.parts.get(transducer.model)
    if isinstance(part, Encoder):
        exact = encoder.read(transducer, part, t_ns, values, draw)
    elif isinstance(part, Mems):
        exact = mems.read(transducer, part, t_ns, values, draw)
    else:
        exact = potentiometer.read(transducer, part or Potentiometer(), sensors.logger, t_ns, values, draw)
    return transducer.saturate(exact)
