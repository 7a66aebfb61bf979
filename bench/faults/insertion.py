"""Fault insertion: the codes of a healthy lap and the faults asked for, to faulty codes and the ground truth.

Belongs here: when a fault acts, and what the rig knows of it. Never: what a kind does, a frame, a verdict.
"""

from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from bench.errors import FaultError
from bench.faults.kinds import KINDS, Acting
from bench.faults.spec import FaultSpec
from bench.sensors.codes import Codes
from bench.sensors.transducers import TRANSDUCERS


class Insertion(NamedTuple):
    """The ground truth of one fault, times in ns after the lap's start.

    t_cmd_ns: when it was asked for. t_active_ns: the first sample that differs from the fault-free twin.
    t_obs_ns: the first sample that differs by more than the sensor's tolerance. None if there is none.
    t_end_ns: when it stops acting, None if not before the lap ends.
    """

    spec: FaultSpec
    t_cmd_ns: int
    t_active_ns: int | None
    t_obs_ns: int | None
    t_end_ns: int | None = None


def insert(codes: Codes, specs: Iterable[FaultSpec]) -> tuple[Codes, list[Insertion]]:
    """`codes` with every fault of `specs` in it, and what each did, in the order given.

    A fault acts on the samples at t_cmd <= t < t_cmd + duration. Faults of one sensor that overlap compose in
    the order given; the twin of a later one is the lap with the earlier ones, so that a fault which changes
    nothing any more has not acted. Raises FaultError for a fault after the last sample or on a sensor whose
    channel the lap lacks.
    """
    arrays = dict(codes.codes)
    done = []
    for spec in specs:
        arrays[spec.sensor], insertion = _insert(replace(codes, codes=arrays), spec)
        done.append(insertion)
    return replace(codes, codes=arrays), done


def _insert(codes: Codes, spec: FaultSpec) -> tuple[np.ndarray, Insertion]:
    transducer = TRANSDUCERS[spec.sensor]
    if spec.sensor not in codes.codes:
        raise FaultError(
            f"{spec}: the lap lacks {transducer.channel}; its sensors are {', '.join(codes.codes)}"
        )
    last_ns = int(codes.t_ns[-1])
    if spec.t_cmd_ns > last_ns:
        raise FaultError(f"{spec}: the lap ends at {last_ns / 1e9:.9g} s")
    healthy = codes.codes[spec.sensor]
    # an end past the lap may not fit int64: the whole rest of the lap then
    end_ns = last_ns + 1 if spec.duration_ns is None else min(spec.t_cmd_ns + spec.duration_ns, last_ns + 1)
    start, stop = (int(k) for k in np.searchsorted(codes.t_ns, (spec.t_cmd_ns, end_ns)))
    faulty = healthy.copy()
    faulty[start:stop] = KINDS[spec.kind].act(
        Acting(healthy, codes.t_ns, start, stop, transducer, dict(spec.params))
    )
    faulty.setflags(write=False)
    error = np.abs(faulty[start:stop] - healthy[start:stop])
    t_ns = codes.t_ns[start:stop]
    return faulty, Insertion(
        spec,
        spec.t_cmd_ns,
        _first(t_ns, error > 0),
        _first(t_ns, error > transducer.tolerance_codes),
        None if end_ns > last_ns else end_ns,
    )


def _first(t_ns: np.ndarray, condition: np.ndarray) -> int | None:
    return int(t_ns[condition.argmax()]) if condition.any() else None
