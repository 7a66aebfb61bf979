"""A fault shown on a few seconds of a made-up ride: what was there, and what the fault makes of it.

Belongs here: the ride and the traces. Never: drawing them.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.codec import Codec
from bench.errors import FaultError
from bench.faults.bus import strike
from bench.faults.insertion import insert
from bench.faults.kinds import KINDS, BusKind, SensorKind
from bench.faults.places import BUS, messages
from bench.faults.spec import FaultSpec, parse_fault
from bench.laps.lap import Lap
from bench.mdlog.logger import Schedule, schedule
from bench.nearest import unknown
from bench.sensors.codes import acquire
from bench.sensors.transducers import BY_CHANNEL, TRANSDUCERS

Floats = NDArray[np.float64]

SENSOR_S, SENSOR_WHEN = 6.0, "@2+3"
BUS_S, BUS_WHEN = 2.0, "@0.5+1"
"""Length of the ride, and when the fault acts; frames need a closer look than strokes."""

_WAVES = {
    "fork_stroke_mm": (60.0, 25.0, 1.1),
    "rear_stroke_mm": (50.0, 20.0, 1.4),
    "pitch_rate_dps": (0.0, 30.0, 1.6),
    "speed_kmh": (80.0, 10.0, 0.2),
    "acc_front_ms2": (0.0, 15.0, 2.3),
    "acc_rear_ms2": (0.0, 15.0, 2.9),
    "acc_body_ms2": (0.0, 5.0, 1.3),
}
"""Channel -> middle, swing, Hz."""
_BIN_NS = 100_000_000


class Example(NamedTuple):
    """A fault and what it does: traces over t_s float64 (instants,), each named WHAT_STATE_UNIT."""

    spec: FaultSpec
    t_s: Floats
    traces: Mapping[str, Floats]


def example(head: str, place: str | None = None) -> Example:
    """The fault `KIND[:PARAM=VALUE,...]`, on `place` or where the kind is commonest. Raises FaultError."""
    name = head.partition(":")[0]
    if "@" in head:
        raise FaultError(f"{head!r}: an example has its own instant, leave out the @")
    if name not in KINDS:
        raise FaultError(unknown("kind", name, KINDS))
    on_bus = isinstance(KINDS[name], BusKind)
    if place is None:
        place = "rear_stroke" if not on_bus else BUS if KINDS[name].where == "bus" else messages()[0]
    spec = parse_fault(f"{place}:{head}{BUS_WHEN if on_bus else SENSOR_WHEN}")
    return _of_frames(spec) if on_bus else _of_codes(spec)


def _ride(seconds: float) -> Lap:
    t_ns = np.arange(round(seconds * 1000)) * 1_000_000
    turns = t_ns * (2.0 * np.pi * 1e-9)
    return Lap(
        t_ns,
        {
            name: middle + swing * (0.7 * np.sin(hz * turns) + 0.3 * np.sin(2.7 * hz * turns))
            for name, (middle, swing, hz) in _WAVES.items()
        },
    )


def _of_codes(spec: FaultSpec) -> Example:
    healthy = acquire(_ride(SENSOR_S))
    faulty, _ = insert(healthy, [spec])
    kind = KINDS[spec.kind]
    also = kind.also(spec.sensor, dict(spec.params)) if isinstance(kind, SensorKind) else ()
    traces = {}
    for sensor in (spec.sensor, *also):
        row = TRANSDUCERS[sensor]
        unit = row.channel.rsplit("_", 1)[1]
        for state, codes in (("healthy", healthy), ("faulty", faulty)):
            traces[f"{sensor}_{state}_{unit}"] = row.to_physical(codes.codes[sensor])
    return Example(spec, healthy.t_ns / 1e9, traces)


def _of_frames(spec: FaultSpec) -> Example:
    codec = Codec()
    healthy = schedule(acquire(_ride(BUS_S)), codec)
    faulty, _ = strike(healthy, [spec], codec)
    # between two cycles, when the frames of the last have been handed over
    t_ns = np.arange(5_000_000, int(BUS_S * 1e9), 10_000_000)
    name = messages()[0] if spec.sensor == BUS else spec.sensor
    before, after = (_heard(plan, t_ns, name, codec) for plan in (healthy, faulty))
    traces = {}
    # what a fault of frames leaves alone is not worth a picture, unless it leaves all alone
    for what, unit in [key for key in before if not np.array_equal(before[key], after[key])] or before:
        traces[f"{what}_healthy_{unit}"] = before[what, unit]
        traces[f"{what}_faulty_{unit}"] = after[what, unit]
    return Example(spec, t_ns / 1e9, traces)


def _heard(plan: Schedule, t_ns: NDArray[np.int64], name: str, codec: Codec) -> dict[tuple[str, str], Floats]:
    """What a receiver has at each of `t_ns`: a message's last channel, its counter, frames a second."""
    mine = np.flatnonzero((plan.ids == codec.message(name).id) & (plan.cycle >= 0))
    latest = mine[np.searchsorted(plan.t_ns[mine], t_ns, side="right") - 1]
    values = codec.decode_all(name, plan.payload[latest])
    channel = next(channel for channel in reversed(values) if channel in BY_CHANNEL)
    quantity, unit = channel.rsplit("_", 1)
    bins = np.bincount(plan.t_ns // _BIN_NS, minlength=int(BUS_S * 1e9) // _BIN_NS)
    return {
        (quantity, unit): values[channel],
        ("alive", "count"): values["alive"],
        ("frames", "hz"): np.asarray(bins[t_ns // _BIN_NS] * (1e9 / _BIN_NS), np.float64),
    }
