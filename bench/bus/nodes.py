"""Nodes as the timed bus sees them: with a CAN controller of their own, or with queue and counters kept here.

Belongs here: what one node would send next, and how errors count for it. Never: other nodes, arbitration.
"""

from heapq import heappop, heappush
from typing import NamedTuple

from bench.bus.confinement import ErrorCounters
from targets.ecu import Confinement, Controller, Ecu, Frame, SeenError


class Entry(NamedTuple):
    """A frame that waits for the bus; what sorts before another is sent before it.

    priority: the bits that arbitration compares. order: of submission. asked_ns: when its node asked.
    """

    priority: int
    order: int
    asked_ns: int
    handle: int
    frame: Frame


def priority(frame: Frame) -> int:
    """The bits that arbitration compares, ISO 11898-1 clause 10.4.2, the first one uppermost.

    At the same base identifier the standard frame's dominant RTR beats the extended one's recessive SRR bit.
    """
    if frame.extended:
        return (frame.id >> 18) << 19 | 1 << 18 | (frame.id & 0x3FFFF)
    return frame.id << 19


class QueueNode:
    """A node that sends its frames by priority and repeats what fails; from bus-off it recovers by itself.

    ecu: is told what is sent and received, None for one whose owner looks at what the bus delivers.
    """

    controller: Controller | None = None

    def __init__(self, name: str, ecu: Ecu | None = None) -> None:
        self.name = name
        self.ecu = ecu
        self.counters = ErrorCounters()
        self._queue: list[Entry] = []

    @property
    def waiting(self) -> int:
        """Frames not sent yet."""
        return len(self._queue)

    def ask(self, entry: Entry) -> None:
        """The time of a request has come."""
        heappush(self._queue, entry)

    def offer(self, t_ns: int) -> Entry | None:
        """What it would send now."""
        return None if self.counters.left or not self._queue else self._queue[0]

    def confinement(self) -> Confinement:
        """How far it takes part."""
        return self.counters.confinement

    def sent(self, handle: int, t_ns: int) -> None:
        """The frame it offered ended well."""
        heappop(self._queue)
        self.counters.transmitted()
        if self.ecu:
            self.ecu.sent(handle, t_ns)

    def receive(self, frame: Frame, t_ns: int) -> None:
        """Another one's frame ended well."""
        if self.counters.rec:
            self.counters.received()
        if self.ecu and not self.counters.left:
            self.ecu.receive(frame, t_ns)

    def error(self, handle: int | None, error: SeenError, t_ns: int) -> None:
        """It saw an error."""
        self.counters.error(error)


class ControllerNode:
    """A node whose own controller holds its frames; the bus knows only that it wants to send."""

    def __init__(self, name: str, ecu: Ecu, controller: Controller) -> None:
        self.name = name
        self.ecu = ecu
        self.controller = controller
        self._orders: dict[int, int] = {}  # handle -> order of its last submission

    @property
    def waiting(self) -> int:
        """Frames submitted and not sent, as far as the bus was told."""
        return len(self._orders)

    def ask(self, entry: Entry) -> None:
        """The time of a request has come."""
        self._orders[entry.handle] = entry.order

    def offer(self, t_ns: int) -> Entry | None:
        """What its controller would send now."""
        wanted = self.controller.offer(t_ns)
        if wanted is None:
            return None
        order = self._orders.get(wanted.handle, 0)
        return Entry(priority(wanted.frame), order, wanted.t_ns, wanted.handle, wanted.frame)

    def confinement(self) -> Confinement:
        """How far it takes part."""
        return self.controller.confinement()

    def sent(self, handle: int, t_ns: int) -> None:
        """The frame it offered ended well."""
        self._orders.pop(handle, None)
        self.ecu.sent(handle, t_ns)

    def receive(self, frame: Frame, t_ns: int) -> None:
        """Another one's frame ended well."""
        self.ecu.receive(frame, t_ns)

    def error(self, handle: int | None, error: SeenError, t_ns: int) -> None:
        """It saw an error."""
        self.controller.error(handle, error, t_ns)


Node = QueueNode | ControllerNode
