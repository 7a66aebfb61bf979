"""What the data logger notes beside the bus: when each fault began and ceased to act.

Belongs here: faults as frames of FAULT_EVENT, in the DBC's own numbers. Never: the files they end up in.
"""

from collections.abc import Iterable, Sequence

from bench.codec import Codec, Signal
from bench.errors import BusError
from bench.faults.insertion import Insertion
from bench.recorder import NOTES, Row
from targets.ecu import Frame

MESSAGE = "FAULT_EVENT"


def events(insertions: Sequence[Insertion], codec: Codec) -> list[Row]:
    """A row where each fault begins to act and one where it ends, in the order of time.

    A fault begins at the first sample it may change (its command), whether or not it changes that one; one
    that lasts to the end of the lap has no end. Raises BusError for what the DBC has no number for.
    """
    message = codec.message(MESSAGE)
    rows = []
    for number, insertion in enumerate(insertions):
        raw = {
            "number": number,
            "sensor": _number(message.signals["sensor"], insertion.spec.sensor),
            "kind": _number(message.signals["kind"], insertion.spec.kind),
        }
        for acting, t_ns in ((1, insertion.t_cmd_ns), (0, insertion.t_end_ns)):
            if t_ns is not None:
                data = codec.pack(MESSAGE, {**raw, "acting": acting})[0].tobytes()
                rows.append((t_ns, Frame(message.id, data, message.extended), NOTES))
    return sorted(rows, key=lambda row: row[0])


def noted(rows: Iterable[Row], insertions: Sequence[Insertion], codec: Codec) -> list[Row]:
    """`rows` of the bus, ordered in time, with the faults' events before the frames of their instant."""
    return sorted([*events(insertions, codec), *rows], key=lambda row: row[0])


def _number(signal: Signal, name: str) -> int:
    for raw, known in signal.names.items():
        if known == name:
            return raw
    raise BusError(f"signal {signal.name} of {MESSAGE} has no number for {name}")
