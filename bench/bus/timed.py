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
from collections.abc import Callable
from functools import partial
from heapq import heappop, heappush
from typing import Protocol

from bench.bus.bits import INTERMISSION_BITS, frame_bits
from bench.bus.confinement import RECESSIVE_BITS, ErrorCounters
from bench.bus.nodes import ControllerNode, Entry, Node, QueueNode, priority
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
        self._nodes: dict[str, Node] = {RECORDER: QueueNode(RECORDER)} if recorder else {}
        self._controllers: list[ControllerNode] = []
        self._tally = Tally()
        # heap entries: (instant, order of submission, node, entry), waiting for their time
        self._coming: list[tuple[int, int, Node, Entry]] = []
        self._wishing: list[Node] = []  # have something to send, as far as known
        self._off: list[QueueNode] = []  # in bus-off
        self._order = 0
        self._sending: tuple[Node, Delivered] | None = None
        # what a frame that fails still brings: (instant, what happens then), in order
        self._script: deque[tuple[int, Callable[[int], Delivered | None]]] = deque()
        self._last: Node | None = None  # sent the last frame
        self._suspended = False  # it alone wants to send, and must wait
        self._decided_ns = 0
        # back-to-back frames: the start of the first and the bits since, so that rounding never adds up
        self._busy_from_ns = 0
        self._busy_bits = 0
        self._free_ns = 0
        self._quiet_ns = 0  # since when the bus is recessive, while it is free

    def attach(self, ecu: Ecu) -> None:
        """Make `ecu` a node: it is told by the bus itself of the frames sent and received.

        A `Controller` keeps its own queue and error counters, for another one the bus keeps them.
        """
        if ecu.name in self._nodes:
            raise BusError(f"{ecu.name} is on the bus already")
        if isinstance(ecu, Controller):
            node = ControllerNode(ecu.name, ecu, ecu)
            self._controllers.append(node)
            self._nodes[ecu.name] = node
        else:
            self._nodes[ecu.name] = QueueNode(ecu.name, ecu)

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
            sender = self._nodes[node] = QueueNode(node)
        entry = Entry(priority(frame), self._order, t_ns, handle, frame)
        heappush(self._coming, (t_ns, self._order, sender, entry))
        self._order += 1

    def waiting(self, node: str) -> int:
        """Frames of `node` that have been submitted and not been sent."""
        known = self._nodes.get(node)
        if known is None:
            return 0
        return known.waiting + sum(sender is known for _, _, sender, _ in self._coming)

    def counters(self, node: str) -> ErrorCounters | None:
        """Error counters of a node, None of one that is unknown or has a controller of its own."""
        known = self._nodes.get(node)
        return known.counters if isinstance(known, QueueNode) else None

    def latest_errors(self) -> list[ErrorFrame]:
        """The last thousand frames that failed, in order of their start."""
        return list(self._tally.latest_errors)

    def next_decision_ns(self) -> int | None:
        """When the bus next starts or ends a frame, as far as submitted; None if nothing is to be sent."""
        if self._sending is not None:
            return self._sending[1].t_end_ns
        if self._script:
            return self._script[0][0]
        if self._wishing and not self._suspended:
            return self._free_ns
        instants = [self._resumes_ns()] if self._wishing else []
        if self._coming:
            instants.append(max(self._coming[0][0], self._free_ns))
        instants += [max(self._recovers_ns(node), self._free_ns) for node in self._off if node.waiting]
        return min(instants, default=None)

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
        coming, wishing = self._coming, self._wishing
        while coming and coming[0][0] <= t_ns:
            _, _, node, entry = heappop(coming)
            node.ask(entry)
            if node not in wishing:
                wishing.append(node)
        if self._off:
            self._recover(t_ns)
        offers: list[tuple[Entry, Node]] = []
        self._suspended = False
        for node in list(wishing):
            if node is self._last and self._must_wait(t_ns):
                self._suspended = True
                continue
            entry_or_none = node.offer(t_ns)
            if entry_or_none is None:
                wishing.remove(node)
            else:
                offers.append((entry_or_none, node))
        if not offers:
            return
        self._suspended = False
        entry, winner = min(offers, key=lambda offer: offer[0])
        for rival, node in offers:
            if rival.priority == entry.priority and node is not winner:
                raise BusError(
                    f"{winner.name} and {node.name} send identifier {entry.frame.id:#x} at once, at {t_ns} ns"
                )
        self._start(t_ns, winner, entry)
        for rival, node in offers:
            if node is not winner and node.controller:
                node.controller.lost(rival.handle)

    def _start(self, t_ns: int, sender: Node, entry: Entry) -> None:
        if t_ns > self._free_ns or self._busy_bits == 0:
            self._busy_from_ns, self._busy_bits = t_ns, 0
        for off in self._off:
            off.counters.recessive(self._bits_of(t_ns - self._quiet_ns))
        for node in self._controllers:
            node.controller.started(entry.handle if node is sender else None, t_ns)
        self._last = sender
        frame = entry.frame
        inverted = self._disturbance.bit_error(frame, t_ns) if self._disturbance else None
        if inverted is not None or not self._recorder:
            others = [node for node in self._nodes.values() if node is not sender and node.confinement()]
            outcome = carry(frame, sender.confinement(), [node.confinement() for node in others], inverted)
            if 0 not in outcome.valid:
                self._fail(t_ns, [sender, *others], entry, outcome)
                return
        bits = frame_bits(frame.id, frame.data, frame.extended)
        end_ns = self._after(self._busy_bits + bits)
        self._take(bits)
        self._sending = sender, Delivered(t_ns, end_ns, sender.name, entry.handle, frame, bits)
        self._tally.delivered(frame, bits, self._free_ns - t_ns, t_ns - entry.asked_ns)

    def _take(self, bits: int) -> None:
        """The wire is taken for `bits` bits, their intermission included."""
        self._quiet_ns = self._after(self._busy_bits + bits - DELIMITER_BITS)
        self._busy_bits += bits + INTERMISSION_BITS
        self._free_ns = self._after(self._busy_bits)

    def _deliver(self, sender: Node, done: Delivered) -> Delivered:
        self._sending = None
        for node in self._nodes.values():
            if node is sender:
                node.sent(done.handle, done.t_end_ns)
            else:
                node.receive(done.frame, done.t_end_ns)
        return done

    def _fail(self, t_ns: int, stations: list[Node], entry: Entry, outcome: Outcome) -> None:
        """Lay out what a frame that fails brings."""
        sender = stations[0]
        script: list[tuple[int, Callable[[int], Delivered | None]]] = []
        begun = self._busy_bits
        handle: int | None = entry.handle
        error = next(seen for seen in outcome.seen if seen.error)
        for seen in outcome.seen:
            node = stations[seen.station]
            own = handle if node is sender else None
            if seen.error is None:
                handle = None
            script.append((self._after(begun + seen.bit + 1), partial(self._see, node, own, seen.error)))
        bits = frame_bits(entry.frame.id, entry.frame.data, entry.frame.extended)
        if outcome.valid:  # only an error in the very last bit leaves the receivers with a valid frame
            done = Delivered(t_ns, self._after(begun + bits), sender.name, entry.handle, entry.frame, bits)
            hearers = [node for number, node in enumerate(stations) if number in outcome.valid]
            script.append((done.t_end_ns, partial(self._hear, hearers, done)))
        self._take(outcome.bits)
        end_ns = self._after(begun + outcome.bits)
        self._script = deque([*script, (end_ns, self._end_failed)])
        seen_ns = self._after(begun + error.bit + 1)
        assert error.error is not None
        failed = ErrorFrame(t_ns, seen_ns, end_ns, sender.name, entry.frame, error.error.code)
        self._tally.failed(failed, self._free_ns - t_ns)

    def _see(self, node: Node, handle: int | None, error: SeenError | None, t_ns: int) -> None:
        if error is not None:
            node.error(handle, error, t_ns)
            if isinstance(node, QueueNode) and node.counters.left and node not in self._off:
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

    def _must_wait(self, t_ns: int) -> bool:
        """Whether the node that sent last has to leave the bus to others for a while."""
        last = self._last
        return t_ns < self._resumes_ns() and last is not None and last.confinement() is Confinement.PASSIVE

    def _resumes_ns(self) -> int:
        return self._after(self._busy_bits + SUSPEND_BITS)

    def _recover(self, t_ns: int) -> None:
        for node in list(self._off):
            if self._recovers_ns(node) <= t_ns:
                node.counters.recessive(RECESSIVE_BITS * node.counters.left)
                self._off.remove(node)
                if node.waiting and node not in self._wishing:
                    self._wishing.append(node)

    def _recovers_ns(self, node: QueueNode) -> int:
        """When the node's bus-off ends if the bus stays idle."""
        return self._quiet_ns + self._ns_of(RECESSIVE_BITS * node.counters.left)

    def _after(self, bits: int) -> int:
        """The instant `bits` after the start of the busy period, rounded to the nearest nanosecond."""
        return self._busy_from_ns + self._ns_of(bits)

    def _ns_of(self, bits: int) -> int:
        return (2 * bits * _SECOND_NS + self.bitrate) // (2 * self.bitrate)

    def _bits_of(self, ns: int) -> int:
        return (2 * ns * self.bitrate + _SECOND_NS) // (2 * _SECOND_NS)
