"""Nodes as the timed bus sees them: with a CAN controller of their own, or with an error state kept here.

Belongs here: what one node does with what the bus tells it. Never: other nodes, queues, arbitration.
"""

from bench.bus.confinement import ErrorCounters
from targets.ecu import Confinement, Controller, Ecu, Frame, SeenError, Transmission


def priority(frame: Frame) -> int:
    """The bits that arbitration compares, ISO 11898-1 clause 10.4.2, the first one uppermost.

    At the same base identifier the standard frame's dominant RTR beats the extended one's recessive SRR bit.
    """
    if frame.extended:
        return (frame.id >> 18) << 19 | 1 << 18 | (frame.id & 0x3FFFF)
    return frame.id << 19


class PlainNode:
    """A node whose queue and error counters are the bus's business; from bus-off it recovers by itself.

    ecu: is told what is sent and received, None for one whose owner looks at what the bus delivers.
    concerned: whether it minds what others send. waiting: frames submitted and not sent.
    """

    controller = None

    def __init__(self, name: str, ecu: Ecu | None = None) -> None:
        self.name = name
        self.ecu = ecu
        self.counters = ErrorCounters()
        self.concerned = ecu is not None
        self.waiting = 0

    def confinement(self) -> Confinement:
        """How far it takes part."""
        return self.counters.confinement

    def sent(self, handle: int, t_ns: int) -> None:
        """Its frame ended well."""
        self.waiting -= 1
        if self.counters.tec:
            self.counters.transmitted()
        if self.ecu:
            self.ecu.sent(handle, t_ns)

    def receive(self, frame: Frame, t_ns: int) -> None:
        """Another one's frame ended well."""
        self.counters.received()
        self.concerned = self.ecu is not None or self.counters.rec > 0
        if self.ecu and not self.counters.left:
            self.ecu.receive(frame, t_ns)

    def error(self, handle: int | None, error: SeenError, t_ns: int) -> None:
        """It saw an error."""
        self.counters.error(error)
        self.concerned = True


class ControllerNode:
    """A node whose controller holds its frames; the bus knows only that it has something to send.

    orders: of submission of its requests, by handle, as far as known; empty if it wants nothing.
    """

    concerned = True

    def __init__(self, ecu: Ecu, controller: Controller) -> None:
        self.name = ecu.name
        self.ecu = ecu
        self.controller = controller
        self.waiting = 0
        self.orders: dict[int, int] = {}

    def ask(self, handle: int, order: int) -> None:
        """The time of a request has come."""
        if handle in self.orders:
            self.waiting -= 1  # it asks anew for what it had asked for
        self.orders[handle] = order

    def offer(self, t_ns: int) -> tuple[Transmission, int] | None:
        """What its controller would start now, and the order of that request."""
        wanted = self.controller.offer(t_ns)
        if wanted is None:  # withdrawn, given up, or it will ask anew
            self.waiting -= len(self.orders)
            self.orders.clear()
            return None
        return wanted, self.orders.get(wanted.handle, 0)

    def confinement(self) -> Confinement:
        """How far it takes part."""
        return self.controller.confinement()

    def sent(self, handle: int, t_ns: int) -> None:
        """The frame it offered ended well."""
        if self.orders.pop(handle, None) is not None:
            self.waiting -= 1
        self.ecu.sent(handle, t_ns)

    def receive(self, frame: Frame, t_ns: int) -> None:
        """Another one's frame ended well."""
        self.ecu.receive(frame, t_ns)

    def error(self, handle: int | None, error: SeenError, t_ns: int) -> None:
        """It saw an error."""
        self.controller.error(handle, error, t_ns)


Node = PlainNode | ControllerNode
