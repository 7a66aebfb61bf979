"""Where faults act: sensors, those of them that are potentiometers, the logger's messages, its bus.

Belongs here: the names of places by class. Never: which kind acts where (the kinds' tables).
"""

from functools import cache

from bench.mdlog.logger import NODE
from bench.sensors.transducers import TRANSDUCERS

BUS = "bus"
"""The place of a bus fault that concerns all the logger sends."""

SENSORS = tuple(TRANSDUCERS)
POTENTIOMETERS = tuple(row.sensor for row in TRANSDUCERS.values() if row.ratiometric)

WHERE = {
    "sensor": "a sensor",
    "potentiometer": "a stroke potentiometer",
    "message": "a message of the logger, or bus for all of them",
    "bus": "bus",
}
"""Class of places -> in words."""


@cache
def messages() -> tuple[str, ...]:
    """The logger's cyclic messages in the bench's own DBC."""
    from bench.codec import Codec  # parses the DBC: only a bus fault waits for it

    return tuple(m.name for m in Codec().messages() if NODE in m.senders and m.cycle_ms > 0)


def places(where: str) -> tuple[str, ...]:
    """The names of the places of a class."""
    if where == "sensor":
        return SENSORS
    if where == "potentiometer":
        return POTENTIOMETERS
    return (*messages(), BUS) if where == "message" else (BUS,)
