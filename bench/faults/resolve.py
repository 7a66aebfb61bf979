"""A fault's triggers on a lap: from sector, condition and chance to plain times.

Belongs here: finding the instants. Never: how a trigger is written, what a fault does.
"""

from dataclasses import replace
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from bench.errors import FaultError
from bench.faults.spec import FaultSpec
from bench.faults.trigger import Random, Sector, When
from bench.laps.lap import Lap

_SPEED = "speed_kmh"
_COMPARE = {">": np.greater, "<": np.less, ">=": np.greater_equal, "<=": np.less_equal}


def resolve(spec: FaultSpec, lap: Lap) -> FaultSpec:
    """`spec` with plain times, as its triggers come true on `lap`: channels' true values, before any sensor.

    A fault without triggers is returned as it is. One whose end condition never holds once it has begun lasts
    to the lap's end. Raises FaultError for a start that never comes, and for a channel the lap lacks.
    """
    if spec.resolved:
        return spec
    t_ns = lap.t_ns - lap.t_ns[0]
    begin_ns = spec.t_cmd_ns
    if isinstance(spec.start, Sector):
        begin_ns = _enters(spec, spec.start, lap, t_ns)
    elif isinstance(spec.start, When):
        begin_ns = _starts(spec, spec.start, lap, t_ns)
    elif isinstance(spec.start, Random):
        begin_ns = _drawn(spec, spec.start)
    duration_ns = spec.duration_ns
    if spec.until is not None:
        values = _values(spec, spec.until, lap)
        after = t_ns > begin_ns
        end_ns = _holds(spec.until, t_ns[after], values[after])
        duration_ns = None if end_ns is None else end_ns - begin_ns
    return replace(spec, t_cmd_ns=begin_ns, duration_ns=duration_ns, start=None, until=None)


def _enters(spec: FaultSpec, sector: Sector, lap: Lap, t_ns: NDArray[np.int64]) -> int:
    """The first sample with (number - 1) / of of the way behind it; of the time, where there is no speed."""
    if _SPEED in lap.channels:
        rate = np.abs(lap.channels[_SPEED])
        steps = 0.5 * (rate[1:] + rate[:-1]) * np.diff(t_ns)
    else:
        steps = np.diff(t_ns).astype(np.float64)
    way = np.concatenate(([0.0], np.cumsum(steps)))
    if way[-1] == 0.0:
        raise FaultError(f"{spec}: the motorcycle stands all the lap, it has no sectors")
    return int(t_ns[np.searchsorted(way, (sector.number - 1) / sector.of * way[-1])])


def _starts(spec: FaultSpec, when: When, lap: Lap, t_ns: NDArray[np.int64]) -> int:
    values = _values(spec, when, lap)
    found = _holds(when, t_ns, values)
    if found is None:
        raise FaultError(
            f"{spec}: never comes true in this lap, whose {when.channel} is "
            f"{values.min():.6g} to {values.max():.6g}"
        )
    return found


def _values(spec: FaultSpec, when: When, lap: Lap) -> NDArray[np.float64]:
    if when.channel not in lap.channels:
        raise FaultError(f"{spec}: the lap lacks {when.channel}; it has {', '.join(lap.channels)}")
    return lap.channels[when.channel]


def _holds(when: When, t_ns: NDArray[np.int64], values: NDArray[np.float64]) -> int | None:
    """The first sample at which the condition has held, sample by sample, for long enough."""
    true = _COMPARE[when.than](values, when.value)
    began = np.flatnonzero(true & ~np.concatenate(([False], true[:-1])))
    if not began.size:
        return None
    # of each sample the latest beginning at or before it; those before the first have none
    latest = np.searchsorted(began, np.arange(len(true)), side="right") - 1
    enough = true & (latest >= 0) & (t_ns - t_ns[began[latest]] >= when.for_ns)
    return int(t_ns[enough.argmax()]) if enough.any() else None


def _drawn(spec: FaultSpec, window: Random) -> int:
    key = crc32(f"{spec.sensor}:{spec.kind}".encode())
    random = np.random.Generator(np.random.PCG64(np.random.SeedSequence([window.seed, key])))
    return int(random.integers(window.low_ns, window.high_ns))
