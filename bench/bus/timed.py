"""A CAN bus in virtual time: arbitration by priority, frames as long as their bits, no thread and no clock.

Belongs here: who sends when. Never: what a frame means, which node there is, a wall clock.

Rules: an idle bus starts the frame of the highest priority among those submitted up to that instant; a frame
once started is never interrupted; three bits of intermission follow it. Time only grows. The caller brings
all nodes to `next_decision_ns()` and submits what they ask for, then steps to that instant.

FIDELITY: every receiver acknowledges, no bit errors, no error or overload frames, no bus-off; propagation
delay is zero; an idle bus starts at the nanosecond of the request, not at a bit boundary; a node's queue is
sorted by priority; a request cannot be withdrawn; a frame counts as received at the end of its end of frame.
"""

from heapq import heappop, heappush
from typing import NamedTuple

from bench.bus.bits import INTERMISSION_BITS, frame_bits
from bench.errors import BusError
from targets.ecu import Frame

_SECOND_NS = 1_000_000_000

EXTENDED = 0x8000_0000
"""Added to a 29-bit identifier where identifiers are keys, as SocketCAN does."""


class Delivered(NamedTuple):
    """A frame that went over the bus: its start of frame, the end of its end of frame, and who sent it."""

    t_start_ns: int
    t_end_ns: int
    node: str
    handle: int
    frame: Frame
    bits: int


class Traffic(NamedTuple):
    """What one identifier did: frames delivered, and the longest wait from submission to start of frame."""

    frames: int
    worst_wait_ns: int


class Load(NamedTuple):
    """What the bus did up to an instant; times in ns.

    bits: of the delivered frames, stuff bits included, intermissions not. busy_ns: sending, intermissions
    included. load: busy_ns over the elapsed time, 0 to 1. by_id: identifier (29 bits: + EXTENDED) -> Traffic.
    """

    bits: int
    busy_ns: int
    elapsed_ns: int
    load: float
    by_id: dict[int, Traffic]


class TimedBus:
    """A bus of `bitrate` bit/s, 1 to 1,000,000, idle at t = 0. Raises BusError for another rate."""

    def __init__(self, bitrate: int = 500_000) -> None:
        if not 1 <= bitrate <= 1_000_000:
            raise BusError(f"bit rate {bitrate} bit/s is not within 1 to 1000000, the range of classic CAN")
        self.bitrate = bitrate
        # heap entries: (instant, order of submission, priority, node, handle, frame), waiting for their time
        self._coming: list[tuple[int, int, int, str, int, Frame]] = []
        # and (priority, order of submission, instant, node, handle, frame), waiting for the bus
        self._pending: list[tuple[int, int, int, str, int, Frame]] = []
        self._order = 0
        self._sending: Delivered | None = None
        self._decided_ns = 0
        # back-to-back frames: the start of the first and the bits since, so that rounding never adds up
        self._busy_from_ns = 0
        self._busy_bits = 0
        self._free_ns = 0
        self._bits = 0
        self._busy_ns = 0
        self._traffic: dict[int, list[int]] = {}

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
        # the bits that arbitration compares, ISO 11898-1 clause 10.4.2: at the same base identifier the
        # standard frame's dominant RTR bit beats the extended one's recessive SRR bit
        priority = (
            (frame.id >> 18) << 19 | 1 << 18 | (frame.id & 0x3FFFF) if frame.extended else frame.id << 19
        )
        heappush(self._coming, (t_ns, self._order, priority, node, handle, frame))
        self._order += 1

    def next_decision_ns(self) -> int | None:
        """When the bus next starts or ends a frame, as far as submitted; None if nothing is to be sent."""
        if self._sending is not None:
            return self._sending.t_end_ns
        if self._pending:
            return self._free_ns
        if self._coming:
            return max(self._coming[0][0], self._free_ns)
        return None

    def step(self, until_ns: int) -> Delivered | None:
        """Run to the next frame that ends at or before `until_ns` and return it, or to `until_ns` and None.

        Raises BusError if two nodes win an arbitration with the same identifier.
        """
        while (decision_ns := self.next_decision_ns()) is not None and decision_ns <= until_ns:
            self._decided_ns = decision_ns
            if self._sending is not None:
                done, self._sending = self._sending, None
                return done
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
        by_id = {key: Traffic(frames, wait) for key, (frames, wait) in sorted(self._traffic.items())}
        share = self._busy_ns / elapsed_ns if elapsed_ns > 0 else 0.0
        return Load(self._bits, self._busy_ns, elapsed_ns, share, by_id)

    def _arbitrate(self, t_ns: int) -> None:
        """Start the frame of the highest priority of all that are pending at `t_ns`."""
        coming, pending = self._coming, self._pending
        while coming and coming[0][0] <= t_ns:
            asked_ns, order, priority, node, handle, frame = heappop(coming)
            heappush(pending, (priority, order, asked_ns, node, handle, frame))
        priority, _, asked_ns, node, handle, frame = heappop(pending)
        if pending and pending[0][0] == priority:
            rival = next((entry[3] for entry in pending if entry[0] == priority and entry[3] != node), None)
            if rival is not None:
                raise BusError(f"{node} and {rival} send identifier {frame.id:#x} at once, at {t_ns} ns")
        if t_ns > self._free_ns or self._busy_bits == 0:
            self._busy_from_ns, self._busy_bits = t_ns, 0
        bits = frame_bits(frame.id, frame.data, frame.extended)
        end_ns = self._after(self._busy_bits + bits)
        self._busy_bits += bits + INTERMISSION_BITS
        self._free_ns = self._after(self._busy_bits)
        self._sending = Delivered(t_ns, end_ns, node, handle, frame, bits)
        self._bits += bits
        self._busy_ns += self._free_ns - t_ns
        key = frame.id | EXTENDED if frame.extended else frame.id
        traffic = self._traffic.setdefault(key, [0, 0])
        traffic[0] += 1
        traffic[1] = max(traffic[1], t_ns - asked_ns)

    def _after(self, bits: int) -> int:
        """The instant `bits` after the start of the busy period, rounded to the nearest nanosecond."""
        return self._busy_from_ns + (2 * bits * _SECOND_NS + self.bitrate) // (2 * self.bitrate)
