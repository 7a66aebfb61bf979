"""Fault insertion: the codes of a healthy lap and the faults asked for, to faulty codes and the ground truth.

Belongs here: when a fault acts, and what the rig knows of it. Never: what a kind does, a frame, a verdict.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.errors import FaultError
from bench.faults.kind import Acting, SensorKind
from bench.faults.kinds import KINDS
from bench.faults.spec import FaultSpec
from bench.sensors.codes import Codes
from bench.sensors.transducers import TRANSDUCERS


class Insertion(NamedTuple):
    """The ground truth of one fault, times in ns after the lap's start.

    t_cmd_ns: when it was asked for. t_active_ns: the first sample or frame that differs from the fault-free
    twin. t_obs_ns: the first sample that differs by more than the sensor's tolerance. None if there is none.
    t_end_ns: when it stops acting, None if not before the lap ends.
    """

    spec: FaultSpec
    t_cmd_ns: int
    t_active_ns: int | None
    t_obs_ns: int | None
    t_end_ns: int | None = None


def insert(codes: Codes, specs: Iterable[FaultSpec]) -> tuple[Codes, list[Insertion]]:
    """`codes` with every fault of `specs` in it, and what each did, in the order given.

    A fault acts on the samples at t_cmd <= t < t_cmd + duration, and a sample depends on nothing after it,
    not even on how long the fault will last. Faults of one sensor that overlap compose in the order given;
    the twin of a later one is the lap with the earlier ones, so that a fault which changes nothing any more
    has not acted. Raises FaultError for a fault after the last sample, on a sensor whose channel the lap
    lacks, on the bus, or whose trigger is not resolved.
    """
    arrays = dict(codes.codes)
    done = []
    for spec in specs:
        changed, insertion = _insert(replace(codes, codes=arrays), spec)
        arrays.update(changed)
        done.append(insertion)
    return replace(codes, codes=arrays), done


def split(specs: Iterable[FaultSpec]) -> tuple[list[FaultSpec], list[FaultSpec]]:
    """The faults of sensors, for `insert`, and those of the bus, for `bus.strike`."""
    every = list(specs)
    return [spec for spec in every if not spec.on_bus], [spec for spec in every if spec.on_bus]


def merged(
    specs: Iterable[FaultSpec], sensors: Sequence[Insertion], bus: Sequence[Insertion]
) -> list[Insertion]:
    """What the two halves of `split(specs)` did, in the order of `specs` again."""
    halves = {False: iter(sensors), True: iter(bus)}
    return [next(halves[spec.on_bus]) for spec in specs]


def refuse_trigger(spec: FaultSpec) -> None:
    """Raise FaultError for a fault without a plain time."""
    if not spec.resolved:
        raise FaultError(f"{spec}: begins or ends on a condition, which only a lap can turn into a time")


def _insert(codes: Codes, spec: FaultSpec) -> tuple[dict[str, NDArray[np.int32]], Insertion]:
    refuse_trigger(spec)
    kind = KINDS[spec.kind]
    if not isinstance(kind, SensorKind):
        raise FaultError(f"{spec}: acts on the bus, not on a sensor")
    params = dict(spec.params)
    sensors = spec.sensors
    for sensor in sensors:
        if sensor not in codes.codes:
            channel = TRANSDUCERS[sensor].channel
            raise FaultError(f"{spec}: the lap lacks {channel}; its sensors are {', '.join(codes.codes)}")
    last_ns = int(codes.t_ns[-1])
    if spec.t_cmd_ns > last_ns:
        raise FaultError(f"{spec}: the lap ends at {last_ns / 1e9:.9g} s")
    # an end past the lap may not fit int64: the whole rest of the lap then
    end_ns = last_ns + 1 if spec.duration_ns is None else min(spec.t_cmd_ns + spec.duration_ns, last_ns + 1)
    start, stop = (int(k) for k in np.searchsorted(codes.t_ns, (spec.t_cmd_ns, end_ns)))
    changed = {}
    differs, observable = np.zeros(stop - start, np.bool_), np.zeros(stop - start, np.bool_)
    for sensor in sensors:
        transducer, healthy = TRANSDUCERS[sensor], codes.codes[sensor]
        faulty = healthy.copy()
        faulty[start:stop] = kind.act(
            Acting(healthy, codes.t_ns, start, stop, transducer, params, spec.t_cmd_ns, codes.codes)
        )
        faulty.setflags(write=False)
        error = np.abs(faulty[start:stop] - healthy[start:stop])
        differs |= error > 0
        observable |= error > transducer.tolerance_codes
        changed[sensor] = faulty
    t_ns = codes.t_ns[start:stop]
    return changed, Insertion(
        spec,
        spec.t_cmd_ns,
        _first(t_ns, differs),
        _first(t_ns, observable),
        None if end_ns > last_ns else end_ns,
    )


def _first(t_ns: np.ndarray, condition: np.ndarray) -> int | None:
    return int(t_ns[condition.argmax()]) if condition.any() else None
