"""MAV_CMD_INJECT_FAILURE in the bench's words: which sensors, which kind of fault.

Belongs here: the two tables. Never: whether a sensor is in the lap, who may inject.
"""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from bench.faults.kinds import KINDS
from bench.mavlink.packets import common

UNITS = {
    "FAILURE_UNIT_SENSOR_GYRO": ("pitch_rate",),
    "FAILURE_UNIT_SENSOR_ACCEL": ("acc_front", "acc_rear", "acc_body"),
    "FAILURE_UNIT_SENSOR_DISTANCE_SENSOR": ("fork_stroke", "rear_stroke"),
}
"""Unit -> the sensors that are its instances 1, 2, ..."""

TYPES = {
    "FAILURE_TYPE_OFF": "open",
    "FAILURE_TYPE_STUCK": "hold",
    "FAILURE_TYPE_GARBAGE": "noise",
    "FAILURE_TYPE_WRONG": "uncalibration",
    "FAILURE_TYPE_SLOW": "slow",
    "FAILURE_TYPE_DELAYED": "delay",
    "FAILURE_TYPE_INTERMITTENT": "loose_contact",
}
"""Failure type -> fault kind, with the parameters the kind has by itself."""

OK = "FAILURE_TYPE_OK"


class Failure(NamedTuple):
    """What a command asks for. sensors: one, or a unit's all (instance 0). kind: None to end their faults."""

    sensors: tuple[str, ...]
    kind: str | None

    def __str__(self) -> str:
        return f"{'+'.join(self.sensors)}:{self.kind or 'ok'}"


def failure(fields: Mapping[str, Any]) -> Failure | None:
    """What the command with these fields asks for; None if the bench has no such unit, instance or kind."""
    unit, kind = (_named(enum, fields[name]) for enum, name in (("UNIT", "param1"), ("TYPE", "param2")))
    instance = _whole(fields["param3"])
    sensors = UNITS.get(unit, ())
    if instance is None or not 0 <= instance <= len(sensors) or not sensors:
        return None
    chosen = sensors[instance - 1 : instance] if instance else sensors
    if kind == OK:
        return Failure(chosen, None)
    return Failure(chosen, TYPES[kind]) if TYPES.get(kind) in KINDS else None


def _named(enum: str, value: float) -> str:
    whole = _whole(value)
    entry = None if whole is None else common().enums[f"FAILURE_{enum}"].get(whole)
    return entry.name if entry else ""


def _whole(value: float) -> int | None:
    return int(value) if math.isfinite(value) and value == int(value) else None
