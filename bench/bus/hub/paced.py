"""The hub's frames on the timed bus: they travel at its bit rate and win by their priority.

Belongs here: handing frames to `TimedBus` and back. Never: arbitration, lengths (bench.bus), a clock.

Each sender offers its oldest frame, as a controller with one mailbox does. Frames of one sender keep their
order; between senders the identifier decides.

FIDELITY: two senders of one identifier at once take turns in the order of their requests, where a real bus
would see bit errors; a remote frame counts as a data frame without data; an error frame that a client sends
is handed on at once and takes no time; nobody fails to acknowledge.
"""

from collections import deque
from collections.abc import Hashable, Iterator
from typing import Any

from bench.bus.hub import wire
from bench.bus.timed import TimedBus
from targets.ecu import Frame

DEPTH = 64
"""Frames of one sender that wait here; the others wait in its socket."""


class Paced:
    """Frames on their way over a bus of `bitrate` bit/s. Times: ns on the caller's clock, from 0."""

    def __init__(self, bitrate: int) -> None:
        self.bitrate = bitrate
        self._bus = TimedBus(bitrate)
        self._waiting: dict[Any, deque[bytearray]] = {}
        self._slots: dict[Any, int] = {}  # a sender with frames -> its node's number, the lowest free one
        self._senders: dict[str, Any] = {}
        # identifiers on offer: the bus knows no two nodes with the same; the others wait for their turn
        self._offered: dict[tuple[int, bool], deque[Any]] = {}

    def has_room(self, sender: Hashable) -> bool:
        """Whether `sender` may put more."""
        return len(self._waiting.get(sender, ())) < DEPTH

    def put(self, sender: Hashable, batch: bytes | bytearray, now_ns: int) -> Iterator[bytearray]:
        """Queue the frames of `batch`; those that take no time on the bus come back. WireError for FD."""
        at = 0
        for end, record in wire.whole(batch):
            wrong = wire.fault(record.flags, record.dlc, record.id, len(record.body), classic=True)
            if wrong:
                raise wire.WireError(wrong)
            frame = bytearray(batch[at:end])
            at = end
            if record.flags & wire.ERROR:
                yield frame
                continue
            queue = self._waiting.setdefault(sender, deque())
            queue.append(frame)
            if len(queue) == 1:
                self._offer(sender, now_ns)

    def run(self, now_ns: int) -> Iterator[tuple[Any, int, bytearray]]:
        """What has ended on the bus up to `now_ns`: sender, instant of the end, the frame."""
        while (done := self._bus.step(now_ns)) is not None:
            sender = self._senders[done.node]
            queue = self._waiting[sender]
            frame = queue.popleft()
            key = (done.frame.id, done.frame.extended)
            turns = self._offered[key]
            turns.popleft()
            if turns:
                self._submit(turns[0], done.t_end_ns)
            else:
                del self._offered[key]
            if queue:
                self._offer(sender, done.t_end_ns)
            else:
                del self._waiting[sender]
                del self._senders[str(self._slots.pop(sender))]
            yield sender, done.t_end_ns, frame

    def due_ns(self) -> int | None:
        """When the bus next starts or ends a frame; None: nothing is to be sent."""
        return self._bus.next_decision_ns()

    def _offer(self, sender: Hashable, t_ns: int) -> None:
        frame = _frame(self._waiting[sender][0])
        turns = self._offered.setdefault((frame.id, frame.extended), deque())
        turns.append(sender)
        if len(turns) == 1:
            self._submit(sender, t_ns)

    def _submit(self, sender: Hashable, t_ns: int) -> None:
        if sender not in self._slots:
            taken = set(self._slots.values())
            slot = next(number for number in range(len(taken) + 1) if number not in taken)
            self._slots[sender] = slot
            self._senders[str(slot)] = sender
        self._bus.submit(t_ns, str(self._slots[sender]), 0, _frame(self._waiting[sender][0]))


def _frame(record: bytearray) -> Frame:
    _, _, flags, _, identifier, _ = wire.HEAD.unpack_from(record)
    return Frame(identifier, bytes(record[wire.HEAD.size :]), bool(flags & wire.EXTENDED))
