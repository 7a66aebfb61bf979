"""A CAN bus in virtual time: arbitration by priority, frames as long as their bits, no thread and no clock.

Belongs here: who sends when. Never: what a frame means, its bits (wire), sums (traffic), a wall clock.

Rules: an idle bus starts the frame of the highest priority among those submitted up to that instant; a frame
once started is never interrupted; three bits of intermission follow it, and eight more before a node that is
error passive may send again. A disturbed frame ends in an error frame and takes part in the next arbitration
anew. Time only grows. The caller brings all nodes to `next_decision_ns()` and submits what they ask for, then
steps to that instant.

FIDELITY: propagation delay is zero; an idle bus starts at the nanosecond of the request, not at a bit
boundary; the queue of a node without a CAN controller of its own is sorted by priority, its requests cannot
be withdrawn; a frame counts as received at the end of its end of frame; an arbitration is lost at the start.
"""

from collections import deque
from collections.abc import Callable, Iterator
from functools import partial
from heapq import heapify, heappop, heappush
from operator import itemgetter
from typing import Protocol

from bench.bus.bits import INTERMISSION_BITS, frame_bits
from bench.bus.confinement import RECESSIVE_BITS, ErrorCounters
from bench.bus.nodes import ControllerNode, Node, PlainNode, priority
from bench.bus.traffic import EXTENDED, Delivered, ErrorFrame, Load, Tally, Traffic
from bench.bus.wire import DELIMITER_BITS, Outcome, carry
from bench.errors import BusError
from targets.ecu import Confinement, Controller, Ecu, Frame, SeenError

__all__ = ["EXTENDED", "RECORDER", "Delivered", "Disturbance", "ErrorFrame", "Load", "TimedBus", "Traffic"]

_SECOND_NS = 1_000_000_000

RECORDER = "recorder"
"""The bench's own node: acknowledges what it hears, and sends nothing but error flags."""

SUSPEND_BITS = 8
"""Beyond the intermission, for an error passive node that has just sent (clause 10.4.6)."""

_Entry = tuple[int, int, int, Node, int, Frame]
"""Priority, order of submission, instant of the request, node, handle, frame: the lowest is sent first."""


class Disturbance(Protocol):
    """What breaks frames on the wire: it is asked about each one as it starts."""

    def bit_error(self, frame: Frame, t_ns: int) -> int | None:
        """Which bit all nodes see inverted: 0 is the start of frame, stuff bits count; None: none."""


class TimedBus:
    """A bus of `bitrate` bit/s, 1 to 1,000,000, idle at t = 0. Raises BusError for another rate.

    recorder: the bench listens and acknowledges, so that no node is ever alone.
    """

    def __init__(
        self, bitrate: int = 500_000, disturbance: Disturbance | None = None, recorder: bool = True
    ) -> None:
        if not 1 <= bitrate <= 1_000_000:
            raise BusError(f"bit rate {bitrate} bit/s is not within 1 to 1000000, the range of classic CAN")
        self.bitrate = bitrate
        self._disturbance = disturbance
        self._recorder = recorder
        self._nodes: dict[str, Node] = {RECORDER: PlainNode(RECORDER)} if recorder else {}
        self._controllers: list[ControllerNode] = []
        self._tally = Tally()
        # heap entries: (instant, order of submission, priority, node, handle, frame), waiting for their time
        self._coming: list[tuple[int, int, int, Node, int, Frame]] = []
        # and those of plain nodes waiting for the bus
        self._pending: list[_Entry] = []
        self._order = 0
        self._sending: tuple[Node, Delivered] | None = None
        # what a frame that fails still brings: (instant, what happens then), in order
        self._script: deque[tuple[int, Callable[[int], Delivered | None]]] = deque()
        self._last: Node | None = None  # sent the last frame
        self._troubled = False  # a frame has failed: from then on nodes may be passive or off
        self._off: list[PlainNode] = []  # in bus-off
        self._held = False  # what is pending may not be sent before ...
        self._decided_ns = 0
        # back-to-back frames: the start of the first and the bits since, so that rounding never adds up
        self._busy_from_ns = 0
        self._busy_bits = 0
        self._free_ns = 0
        self._suspend_ns = self._ns_of(SUSPEND_BITS)
        self._trail_ns = self._ns_of(DELIMITER_BITS + INTERMISSION_BITS)

    def attach(self, ecu: Ecu) -> None:
        """Make `ecu` a node: it is told by the bus itself of the frames sent and received.

        A `Controller` keeps its own queue and error counters, for another one the bus keeps them.
        """
        if ecu.name in self._nodes:
            raise BusError(f"{ecu.name} is on the bus already")
        if isinstance(ecu, Controller):
            node = ControllerNode(ecu, ecu)
            self._controllers.append(node)
            self._nodes[ecu.name] = node
        else:
            self._nodes[ecu.name] = PlainNode(ecu.name, ecu)

    def submit(self, t_ns: int, node: str, handle: int, frame: Frame) -> None:
        """Ask, for `node`, that `frame` be sent: it takes part in every arbitration at `t_ns` or later.

        `handle` comes back with its Delivered. Raises BusError for a frame that is none, and for an instant
        before the bus's last decision, which can no longer be taken back.
        """
        if t_ns < self._decided_ns:
            raise BusError(
                f"{node} asks at {t_ns} ns to send {frame.id:#x}; the bus is at {self._decided_ns} ns already"
            )
        if not 0 <= frame.id < (1 << 29 if frame.extended else 1 << 11):
            raise BusError(
                f"{node}: identifier {frame.id:#x} has more than {29 if frame.extended else 11} bits"
            )
        if len(frame.data) > 8:
            raise BusError(f"{node}: frame {frame.id:#x} has {len(frame.data)} bytes, more than 8")
        sender = self._nodes.get(node)
        if sender is None:
            sender = self._nodes[node] = PlainNode(node)
        heappush(self._coming, (t_ns, self._order, priority(frame), sender, handle, frame))
        self._order += 1
        sender.waiting += 1

    def waiting(self, node: str) -> int:
        """Frames of `node` that have been submitted and not been sent."""
        return self._nodes[node].waiting if node in self._nodes else 0

    def counters(self, node: str) -> ErrorCounters | None:
        """Error counters of a node, None of one that is unknown or has a controller of its own."""
        known = self._nodes.get(node)
        return known.counters if isinstance(known, PlainNode) else None

    def latest_errors(self) -> list[ErrorFrame]:
        """The last thousand frames that failed, in order of their start."""
        return list(self._tally.latest_errors)

    def next_decision_ns(self) -> int | None:
        """When the bus next starts or ends a frame, as far as submitted; None if nothing is to be sent."""
        if self._sending is not None:
            return self._sending[1].t_end_ns
        if self._script:
            return self._script[0][0]
        if not self._held:
            if self._pending:
                return self._free_ns
            for node in self._controllers:
                if node.orders:
                    return self._free_ns
        next_ns = max(self._coming[0][0], self._free_ns) if self._coming else None
        if self._held:
            next_ns = min((t for t in (next_ns, *self._releases_ns()) if t is not None), default=None)
        return next_ns

    def step(self, until_ns: int) -> Delivered | None:
        """Run to the next frame that ends at or before `until_ns` and return it, or to `until_ns` and None.

        Raises BusError if two nodes win an arbitration with the same identifier.
        """
        while (decision_ns := self.next_decision_ns()) is not None and decision_ns <= until_ns:
            self._decided_ns = decision_ns
            if self._sending is not None:
                return self._deliver(*self._sending)
            if self._script:
                delivered = self._script.popleft()[1](decision_ns)
                if delivered is not None:
                    return delivered
            else:
                self._arbitrate(decision_ns)
        return None

    def advance(self, until_ns: int) -> list[Delivered]:
        """All frames that end at or before `until_ns`, in order: `step` until it returns None."""
        done = []
        while (delivered := self.step(until_ns)) is not None:
            done.append(delivered)
        return done

    def load(self, elapsed_ns: int) -> Load:
        """Statistics over `elapsed_ns` from t = 0, of the frames started so far."""
        return self._tally.load(elapsed_ns)

    def _arbitrate(self, t_ns: int) -> None:
        """Start the frame of the highest priority of all that are pending at `t_ns`."""
        coming, pending = self._coming, self._pending
        while coming and coming[0][0] <= t_ns:
            asked_ns, order, rank, node, handle, frame = heappop(coming)
            if isinstance(node, ControllerNode):
                node.ask(handle, order)
            else:
                heappush(pending, (rank, order, asked_ns, node, handle, frame))
        self._held = False
        if self._troubled:
            self._recover(t_ns)
            entry = min((rival for rival in pending if self._may_send(rival[3], t_ns)), default=None)
        else:
            entry = pending[0] if pending else None
        offers = self._offers(t_ns) if self._controllers else ()
        if offers:
            if entry is not None:
                offers.append(entry)
            entry = min(offers, key=itemgetter(0, 1))
        if entry is None:
            self._held = True
            return
        rank, winner = entry[0], entry[3]
        if pending:
            if pending[0] is entry:
                heappop(pending)
            elif entry in pending:
                pending.remove(entry)
                heapify(pending)
        if offers or (pending and pending[0][0] == rank):
            for rival in (*offers, *pending):
                if rival[0] == rank and rival[3] is not winner:
                    raise BusError(
                        f"{winner.name} and {rival[3].name} send identifier {entry[5].id:#x} at once, "
                        f"at {t_ns} ns"
                    )
        self._start(t_ns, entry)
        for rival in offers:
            if rival[3] is not winner and rival[3].controller:
                rival[3].controller.lost(rival[4])

    def _offers(self, t_ns: int) -> list[_Entry]:
        """What nodes with a controller of their own would start now."""
        offers: list[_Entry] = []
        for node in self._controllers:
            if node.orders and (not self._troubled or self._may_send(node, t_ns)):
                offered = node.offer(t_ns)
                if offered:
                    (asked_ns, handle, frame), order = offered
                    offers.append((priority(frame), order, asked_ns, node, handle, frame))
        return offers

    def _start(self, t_ns: int, entry: _Entry) -> None:
        _, _, asked_ns, sender, handle, frame = entry
        if t_ns > self._free_ns or self._busy_bits == 0:
            self._busy_from_ns, self._busy_bits = t_ns, 0
        if self._off:
            recessive_bits = self._bits_of(t_ns - self._quiet_ns)
            for off in self._off:
                off.counters.recessive(recessive_bits)
        for node in self._controllers:
            node.controller.started(handle if node is sender else None, t_ns)
        self._last = sender
        inverted = self._disturbance.bit_error(frame, t_ns) if self._disturbance else None
        if inverted is not None or not self._recorder:
            others = [node for node in self._nodes.values() if node is not sender and node.confinement()]
            outcome = carry(frame, sender.confinement(), [node.confinement() for node in others], inverted)
            if 0 not in outcome.valid:
                self._fail(t_ns, entry, others, outcome)
                return
        bits = frame_bits(*frame)
        end_ns = self._take(bits)
        self._sending = sender, Delivered(t_ns, end_ns, sender.name, handle, frame, bits)
        self._tally.delivered(frame, bits, self._free_ns - t_ns, t_ns - asked_ns)

    def _take(self, bits: int) -> int:
        """Take the wire for `bits` bits and their intermission; the end of the former."""
        end_ns = self._after(self._busy_bits + bits)
        self._busy_bits += bits + INTERMISSION_BITS
        self._free_ns = self._after(self._busy_bits)
        return end_ns

    def _deliver(self, sender: Node, done: Delivered) -> Delivered:
        self._sending = None
        sender.sent(done.handle, done.t_end_ns)
        for node in self._nodes.values():
            if node.concerned and node is not sender:
                node.receive(done.frame, done.t_end_ns)
        return done

    def _fail(self, t_ns: int, entry: _Entry, others: list[Node], outcome: Outcome) -> None:
        """Lay out what a frame that fails brings."""
        _, _, _, sender, handle, frame = entry
        if sender.controller is None:
            heappush(self._pending, entry)
        self._troubled = True
        stations = [sender, *others]
        script: list[tuple[int, Callable[[int], Delivered | None]]] = []
        begun = self._busy_bits
        sends = True
        error = next(seen for seen in outcome.seen if seen.error)
        for seen in outcome.seen:
            node = stations[seen.station]
            own = handle if node is sender and sends else None
            sends = sends and seen.error is not None
            script.append((self._after(begun + seen.bit + 1), partial(self._see, node, own, seen.error)))
        bits = frame_bits(frame.id, frame.data, frame.extended)
        if outcome.valid:  # only an error in the very last bit leaves the receivers with a valid frame
            done = Delivered(t_ns, self._after(begun + bits), sender.name, handle, frame, bits)
            hearers = [node for number, node in enumerate(stations) if number in outcome.valid]
            script.append((done.t_end_ns, partial(self._hear, hearers, done)))
        end_ns = self._take(outcome.bits)
        self._script = deque([*script, (end_ns, self._end_failed)])
        seen_ns = self._after(begun + error.bit + 1)
        assert error.error is not None
        failed = ErrorFrame(t_ns, seen_ns, end_ns, sender.name, frame, error.error.code)
        self._tally.failed(failed, self._free_ns - t_ns)

    def _see(self, node: Node, handle: int | None, error: SeenError | None, t_ns: int) -> None:
        if error is not None:
            node.error(handle, error, t_ns)
            if isinstance(node, PlainNode) and node.counters.left and node not in self._off:
                self._off.append(node)
        elif node.controller and handle is not None:
            node.controller.lost(handle)

    @staticmethod
    def _hear(nodes: list[Node], done: Delivered, t_ns: int) -> Delivered:
        for node in nodes:
            node.receive(done.frame, t_ns)
        return done

    def _end_failed(self, t_ns: int) -> None:
        for node in self._controllers:
            node.controller.ended(t_ns)

    @property
    def _quiet_ns(self) -> int:
        """Since when the bus is recessive, while it is free."""
        return self._free_ns - self._trail_ns

    def _may_send(self, node: Node, t_ns: int) -> bool:
        """Whether the node is not in bus-off, nor, as the passive sender of the last frame, suspended."""
        if node is self._last and t_ns < self._free_ns + self._suspend_ns:
            return node.confinement() is Confinement.ACTIVE
        return node not in self._off

    def _releases_ns(self) -> Iterator[int]:
        """When nodes that must not send now may send again, if the bus stays idle."""
        resumes_ns = self._free_ns + self._suspend_ns
        if self._decided_ns < resumes_ns:
            yield resumes_ns
        for node in self._off:
            if node.waiting:
                yield max(self._recovers_ns(node), self._free_ns)

    def _recover(self, t_ns: int) -> None:
        for node in tuple(self._off):
            if self._recovers_ns(node) <= t_ns:
                node.counters.recessive(RECESSIVE_BITS * node.counters.left)
                self._off.remove(node)

    def _recovers_ns(self, node: PlainNode) -> int:
        """When the node's bus-off ends if the bus stays idle."""
        return self._quiet_ns + self._ns_of(RECESSIVE_BITS * node.counters.left)

    def _after(self, bits: int) -> int:
        """The instant `bits` after the start of the busy period, rounded to the nearest nanosecond."""
        return self._busy_from_ns + (2 * bits * _SECOND_NS + self.bitrate) // (2 * self.bitrate)

    def _ns_of(self, bits: int) -> int:
        return (2 * bits * _SECOND_NS + self.bitrate) // (2 * self.bitrate)

    def _bits_of(self, ns: int) -> int:
        return (2 * ns * self.bitrate + _SECOND_NS) // (2 * _SECOND_NS)
