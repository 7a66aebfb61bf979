"""What the sensors say during a lap: one array of integer codes per sensor, on the lap's time base.

Belongs here: the codes and how a lap becomes codes. Never: how one sensor converts, a fault, a frame.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from bench.laps.lap import Lap
from bench.sensors.parts import IDEAL, Sensors
from bench.sensors.streams import streams, time_base
from bench.sensors.transducers import BY_CHANNEL


@dataclass(frozen=True)
class Codes:
    """Sensor codes of one lap; treat the arrays as read-only.

    t_ns: int64 (samples,), strictly increasing, from 0 at the lap's start.
    codes: sensor name -> int32 (samples,). saturated: sensor name -> samples that lay beyond its span.
    """

    t_ns: NDArray[np.int64]
    codes: Mapping[str, NDArray[np.int32]]
    saturated: Mapping[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if len(self.t_ns) == 0 or self.t_ns[0] != 0:
            raise ValueError("codes start at t = 0: rebase the time to the lap's start")
        for sensor, codes in self.codes.items():
            if codes.shape != self.t_ns.shape:
                raise ValueError(f"{sensor}: {codes.size} codes for {self.t_ns.size} instants")


def acquire(lap: Lap, sensors: Sensors = IDEAL, seed: int = 0) -> Codes:
    """Read every channel of `lap` that a sensor of Table II.1 measures, all at the lap's own instants.

    Ideal sensors give the rounded true values. Others draw their imperfections from `seed` and the channel
    itself (`streams`): same lap, sensors and seed, same bytes. Raises SensorError for a negative seed.
    """
    t_ns = lap.t_ns - lap.t_ns[0]
    t_ns.setflags(write=False)
    base = time_base(t_ns) if sensors.parts or sensors.logger else None
    codes, saturated = {}, {}
    for channel, values in lap.channels.items():
        if channel not in BY_CHANNEL:
            continue
        transducer = BY_CHANNEL[channel]
        if base is None or not sensors.touch(transducer):
            array, beyond = transducer.to_codes(values)
        else:
            from bench.sensors.instruments import read  # numba: only who needs it waits for it

            draw = streams(seed, base, transducer.sensor, values)
            array, beyond = read(transducer, sensors, t_ns, values, draw)
        array.setflags(write=False)
        codes[transducer.sensor], saturated[transducer.sensor] = array, beyond
    return Codes(t_ns, codes, saturated)
