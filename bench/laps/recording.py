"""The recording: what a file holds before it is a lap, as it was recorded.

Belongs here: the form in which every reader hands over what it found. Never: a format, and no judgement
of the time base; `bench.laps.timebase` judges, repairs and makes the lap.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Track:
    """One channel's samples in the order of the file; the times may repeat or go back.

    t_ns: int64 (samples,), any origin. values: float64 (samples,), finite, in the channel's unit.
    """

    t_ns: NDArray[np.int64]
    values: NDArray[np.float64]


@dataclass(frozen=True)
class Recording:
    """The tracks of one file, by channel name.

    where: the path, for messages. source: the file's name. common: all tracks were sampled together and
    share one `t_ns`; otherwise each has its own, and the lap's time base is made at `rate_hz` (None: the rate
    of the fastest track). damage: what the reader had to skip, one line each, with its position.
    """

    where: str
    source: str
    tracks: Mapping[str, Track]
    common: bool = True
    rate_hz: float | None = None
    damage: tuple[str, ...] = ()
