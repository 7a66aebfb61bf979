"""A fault in a lap, as the ECU sees it 100 times a second, and what the network then predicts.

Belongs here: the way from codes to faulty samples. Never: what a kind does, an alarm.
FIDELITY: no bus and no ECU between; a sample counts at the instant it is taken, sums are in double precision.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.faults.insertion import insert
from bench.faults.spec import parse_fault
from bench.sensors.codes import Codes
from bench.sensors.transducers import TRANSDUCERS
from campaigns.offline_lap import SAMPLE_NS, Course, fed_measured, free_run, sampled
from targets.narx.network import Narx

Floats = NDArray[np.float64]

SETTLE_NS = 1_000_000_000
"""Inserted beyond t_max: by then a fault nearly always differs from its twin."""


class Faulty(NamedTuple):
    """A lap with a fault, as the ECU sees it until an alarm would be too late: u and y from the lap's start.

    t_active_ns: None for a fault that changes no sample. start: the first sample at or after it. own: whether
    the fault is on the sensor that the network predicts.
    """

    t_cmd_ns: int
    t_active_ns: int | None
    t_obs_ns: int | None
    start: int
    u: Floats
    y: Floats
    own: bool


def inserted(one: Course, fault: str, network: Narx, t_max_s: float) -> Faulty:
    """The lap with a fault, by the bench's own insertion into its sensor's codes."""
    spec, t_max_ns = parse_fault(fault), round(t_max_s * 1e9)
    sensor = TRANSDUCERS[spec.sensor]
    healthy = one.codes.codes[spec.sensor]
    last_ns = int(one.codes.t_ns[-1])
    # a fault may look back as far as it likes, but what is not watched need not be made
    for until_ns in (min(spec.t_cmd_ns + t_max_ns + SETTLE_NS, last_ns), last_ns):
        stop = int(np.searchsorted(one.codes.t_ns, until_ns, side="right"))
        within = Codes(one.codes.t_ns[:stop], {spec.sensor: healthy[:stop]})
        codes, [truth] = insert(within, [spec])
        active_ns = truth.t_active_ns
        if until_ns == last_ns or (active_ns is not None and active_ns + t_max_ns <= until_ns):
            break
    start = len(one.y) if active_ns is None else -(-active_ns // SAMPLE_NS)
    if active_ns is None or start >= len(one.y):
        return Faulty(spec.t_cmd_ns, None, None, len(one.y), one.u, one.y, True)
    end = min((active_ns + t_max_ns) // SAMPLE_NS + 1, len(one.y))
    own = sensor.channel == network.output
    u, y = one.u[:end], one.y[:end]
    acting = sampled(codes, sensor, one.latest[start:end])
    if own:
        y = np.concatenate([y[:start], acting])
    else:
        u = u.copy()
        u[start:, network.inputs.index(sensor.channel)] = acting
    return Faulty(spec.t_cmd_ns, active_ns, truth.t_obs_ns, start, u, y, own)


def predicted(network: Narx, feedback: str, healthy: Floats, faulty: Faulty) -> Floats:
    """What the network predicts of a faulty lap; one that feeds itself never sees a fault of its output."""
    if feedback == "measured":
        # sample `start` itself is predicted from what came before
        return np.concatenate(
            [healthy[: faulty.start], fed_measured(network, faulty.u, faulty.y, faulty.start)]
        )
    return healthy[: len(faulty.y)] if faulty.own else free_run(network, faulty.u)
