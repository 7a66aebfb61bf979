"""One ECU alone: on a timed bus whose only other node acknowledges, or with others on a live one.

Belongs here: who acts when, and the count of what was sent. Never: what a frame means, a screen.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, field

from bench.bus.live import Heard
from bench.bus.timed import EXTENDED, TimedBus
from bench.errors import BusError
from bench.live import Bus
from bench.rig import MOST_WAITING
from bench.serve import serve
from targets.ecu import Ecu, Frame, Transmission

LOOK_NS = 20_000_000


@dataclass
class Sent:
    """Frames of one identifier: how many, the instants of the first and the last, the last one's data."""

    frames: int
    first_ns: int
    last_ns: int
    data: bytes

    @property
    def period_ns(self) -> float | None:
        """Mean distance between two frames, None if there was only one."""
        return (self.last_ns - self.first_ns) / (self.frames - 1) if self.frames > 1 else None


@dataclass
class Tally:
    """What an ECU sent, by identifier (29 bits: + EXTENDED)."""

    by_id: dict[int, Sent] = field(default_factory=dict)

    def add(self, t_ns: int, frame: Frame) -> None:
        """One more frame."""
        key = frame.id | EXTENDED if frame.extended else frame.id
        row = self.by_id.setdefault(key, Sent(0, t_ns, t_ns, b""))
        row.frames += 1
        row.last_ns, row.data = t_ns, frame.data


def run(
    ecu: Ecu,
    bus: TimedBus,
    until_ns: int,
    tally: Tally,
    look: Callable[[int], None] | None = None,
    every_ns: int = LOOK_NS,
) -> None:
    """Run `ecu` from 0 to `until_ns` on `bus`, all that it asks for sent and acknowledged.

    look: called with the instant at least every `every_ns`. Raises FirmwareFault, and BusError for what no
    bus carries; `tally` holds what was sent until then.
    """
    bus.attach(ecu)
    now_ns = 0
    while True:
        decision_ns = bus.next_decision_ns()
        soon_ns = min(until_ns, now_ns + every_ns)
        reach_ns = soon_ns if decision_ns is None else min(soon_ns, decision_ns)
        request = ecu.advance(reach_ns)
        if look:
            look(reach_ns)
        if request is not None:
            bus.submit(request.t_ns, ecu.name, request.handle, request.frame)
            waiting = bus.waiting(ecu.name)
            if waiting > MOST_WAITING:
                raise BusError(f"{ecu.name} floods the bus: {waiting} frames wait at {reach_ns / 1e9:.9g} s")
            continue
        now_ns = reach_ns
        delivered = bus.step(now_ns)
        if delivered is not None:
            tally.add(delivered.t_end_ns, delivered.frame)
        elif now_ns >= until_ns:
            return


class _Counted:
    """A live bus that keeps the tally of what is sent over it."""

    def __init__(self, bus: Bus, tally: Tally, clock: Callable[[], int]) -> None:
        self._bus, self._tally, self._clock, self._begun_ns = bus, tally, clock, clock()
        self.echoes = bus.echoes

    @property
    def refusal(self) -> str:
        return self._bus.refusal

    def send(self, frame: Frame, timeout_s: float = 0.0) -> bool:
        taken = self._bus.send(frame, timeout_s)
        if taken:
            self._tally.add(self._clock() - self._begun_ns, frame)
        return taken

    def receive(self, timeout_s: float) -> Heard | None:
        return self._bus.receive(timeout_s)


class Watched:
    """An ECU on a live bus that is looked at at least every `every_ns` of its time, by `look`."""

    def __init__(self, ecu: Ecu, look: Callable[[int], None], every_ns: int) -> None:
        self.name = ecu.name
        self._ecu, self._look, self._every_ns = ecu, look, every_ns
        self._reached_ns = 0
        self.receive, self.sent, self.where = ecu.receive, ecu.sent, ecu.where

    def advance(self, t_ns: int) -> Transmission | None:
        """As the ECU's own."""
        while True:
            self._reached_ns = min(t_ns, max(self._reached_ns, 0) + self._every_ns)
            request = self._ecu.advance(self._reached_ns)
            self._look(self._reached_ns)
            if request or self._reached_ns >= t_ns:
                return request


def run_live(
    ecu: Ecu,
    bus: Bus,
    tally: Tally,
    seconds: float | None = None,
    ready: Callable[[], None] | None = None,
    clock: Callable[[], int] = time.monotonic_ns,
) -> None:
    """Let `ecu` live on `bus` in wall time, until interrupted or for `seconds`; instants count from here."""
    serve(ecu, _Counted(bus, tally, clock), clock, seconds, ready)
