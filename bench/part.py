"""Which part of a lap is ridden, and how often: cut from its codes, so that filters are warm before it."""

from dataclasses import dataclass, replace

import numpy as np

from bench.errors import LapError
from bench.sensors.codes import Codes

MOST_SAMPLES = 100_000_000


@dataclass(frozen=True)
class Part:
    """Of a lap: from `begin_ns` to `end_ns` (None: its end), `loops` times end to end."""

    begin_ns: int = 0
    end_ns: int | None = None
    loops: int = 1

    def of(self, codes: Codes) -> Codes:
        """That part of `codes`, time from 0 at its beginning.

        Raises LapError if nothing of the lap lies in it, or if it grows too long to be held.
        """
        if self == Part():
            return codes
        last_ns = int(codes.t_ns[-1])
        end_ns = last_ns if self.end_ns is None else self.end_ns
        start, stop = (
            int(np.searchsorted(codes.t_ns, self.begin_ns)),
            int(np.searchsorted(codes.t_ns, end_ns, side="right")),
        )
        if stop - start < 2:
            raise LapError(
                f"nothing to ride from {self.begin_ns / 1e9:g} to {end_ns / 1e9:g} s: "
                f"the lap lasts {last_ns / 1e9:g} s"
            )
        if (stop - start) * self.loops > MOST_SAMPLES:
            raise LapError(
                f"{self.loops} loops of {stop - start} samples: more than {MOST_SAMPLES} altogether"
            )
        t_ns = codes.t_ns[start:stop] - codes.t_ns[start]
        # the last sample lasts as long as the one before it
        lap_ns = int(2 * t_ns[-1] - t_ns[-2])
        t_ns = np.concatenate([t_ns + k * lap_ns for k in range(self.loops)])
        looped = {sensor: np.tile(array[start:stop], self.loops) for sensor, array in codes.codes.items()}
        for array in (t_ns, *looped.values()):
            array.setflags(write=False)
        return replace(codes, t_ns=t_ns, codes=looped)
