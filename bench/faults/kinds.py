"""The fault catalogue: every kind there is, from the three tables where they are.

Belongs here: putting the tables together. Never: what a kind does; adding one is a function and a row there.
"""

from bench.faults import electrical, frames, signal
from bench.faults.kind import BusKind, Choice, Kind, Number, SensorKind, Value

__all__ = ["KINDS", "BusKind", "Choice", "Kind", "Number", "SensorKind", "Value"]

KINDS: dict[str, Kind] = {**signal.KINDS, **electrical.KINDS, **frames.KINDS}
"""Fault kind -> what it is; the thesis's four of section V.2 come first."""
