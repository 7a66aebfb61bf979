"""Bus faults at work: a logger's schedule and the faults asked for, to what it hands to the bus.

Belongs here: when a fault acts, and what the rig knows of it. Never: what a kind does (`frames`), a wire.
"""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bench.codec import Codec
from bench.errors import FaultError
from bench.faults.insertion import Insertion, refuse_trigger
from bench.faults.kinds import KINDS, BusKind
from bench.faults.places import BUS
from bench.faults.spec import FaultSpec
from bench.faults.striking import Striking, Struck, taken
from bench.mdlog.logger import Schedule


def strike(schedule: Schedule, specs: Iterable[FaultSpec], codec: Codec) -> tuple[Schedule, list[Insertion]]:
    """`schedule` with every bus fault of `specs` in it, and what each did, in the order given.

    A fault acts on the frames asked for at t_cmd <= t < t_cmd + duration; it is active, and observable, from
    the first frame that is lost, changed or added. Several compose in the order given. The frames of another
    node (babbling) have cycle -1; the rows stay in the order (t_ns, identifier). Raises FaultError for a
    fault after the last frame, one of a message that is not sent, and one that acts on a sensor.
    """
    done, healthy = [], schedule
    for spec in specs:
        _check(healthy, spec, codec)
        schedule, insertion = _strike(schedule, spec, codec, int(healthy.t_ns[-1]))
        done.append(insertion)
    return schedule, done


def _check(plan: Schedule, spec: FaultSpec, codec: Codec) -> None:
    """Refuse a fault that the schedule without any fault cannot have."""
    refuse_trigger(spec)
    if not spec.on_bus:
        raise FaultError(f"{spec}: acts on a sensor, not on the bus")
    if not _concerned(plan, spec, codec).any():
        missing = plan.unsent.get(spec.sensor, ())
        raise FaultError(
            f"{spec}: nothing is sent" + (f": the lap lacks {', '.join(missing)}" if missing else "")
        )
    if spec.t_cmd_ns > plan.t_ns[-1]:
        raise FaultError(f"{spec}: the last frame is sent at {plan.t_ns[-1] / 1e9:.9g} s")


def _concerned(plan: Schedule, spec: FaultSpec, codec: Codec) -> NDArray[np.bool_]:
    """Which rows are of the fault's place; another node's are of none."""
    mine: NDArray[np.bool_] = plan.cycle >= 0
    if spec.sensor != BUS:
        message = codec.message(spec.sensor)
        mine &= (plan.ids == message.id) & (plan.extended == message.extended)
    return mine


def _strike(plan: Schedule, spec: FaultSpec, codec: Codec, last_ns: int) -> tuple[Schedule, Insertion]:
    kind, params = KINDS[spec.kind], dict(spec.params)
    assert isinstance(kind, BusKind)
    # an end past the lap may not fit int64: the whole rest of the lap then
    end_ns = last_ns + 1
    if spec.duration_ns is not None:
        end_ns = min(end_ns, spec.t_cmd_ns + spec.duration_ns + kind.lasts_ns(params))
    start, stop = (int(k) for k in np.searchsorted(plan.t_ns, (spec.t_cmd_ns, end_ns)))
    rows = start + np.flatnonzero(_concerned(plan, spec, codec)[start:stop])
    struck = kind.strike(Striking(plan, rows, spec.sensor, spec.t_cmd_ns, end_ns, last_ns, params, codec))
    active_ns = _first_ns(plan, struck)
    ends_ns = None if end_ns > last_ns else end_ns
    return _merged(plan, struck), Insertion(spec, spec.t_cmd_ns, active_ns, active_ns, ends_ns)


def _first_ns(plan: Schedule, struck: Struck) -> int | None:
    instants = []
    if struck.lost is not None:
        instants.append(plan.t_ns[struck.lost])
    if struck.payload is not None:
        instants.append(plan.t_ns[(struck.payload != plan.payload).any(axis=1)])
    if struck.added is not None:
        instants.append(struck.added.t_ns)
    return min((int(t_ns[0]) for t_ns in instants if len(t_ns)), default=None)


def _merged(plan: Schedule, struck: Struck) -> Schedule:
    if struck.payload is not None:
        plan = replace(plan, payload=struck.payload)
    if struck.lost is not None:
        kept = np.ones(len(plan), np.bool_)
        kept[struck.lost] = False
        plan = taken(plan, np.flatnonzero(kept))
    if struck.added is not None:
        new = struck.added
        plan = Schedule(
            np.concatenate((plan.t_ns, new.t_ns)),
            np.concatenate((plan.ids, new.ids)),
            np.concatenate((plan.extended, new.extended)),
            np.concatenate((plan.lengths, new.lengths)),
            np.concatenate((plan.payload, new.payload)),
            np.concatenate((plan.cycle, new.cycle)),
            plan.cycle_ns,
            plan.unsent,
        )
        plan = taken(plan, np.lexsort((plan.ids, plan.t_ns)))
    return plan
