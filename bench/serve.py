"""An ECU on a live bus, in wall time: it hears, answers, and says when it cannot keep up.

Frames count from when they arrived, not from when this process came to read them.
"""

import gc
import time
from collections.abc import Callable
from dataclasses import dataclass

from bench.codec import Codec
from bench.errors import BusError
from bench.live import CONTROL_NS, Bus
from bench.mdlog.logger import NODE
from targets.ecu import Ecu, Frame

IDLE_S = 0.005
"""How often the ECU's virtual time is brought up to the clock when no frame comes."""

LOOK_NS = 300_000
AHEAD_NS = 100_000_000
"""Virtual time given to the ECU at once with each frame, and how far that may put it ahead of the clock.

A step and its answer take less; three frames a millisecond, the bus's most, put it no farther ahead.
"""

SEND_S = 1.0
"""How long a frame of the ECU may wait for room in the interface's queue."""


@dataclass
class Served:
    """How an ECU fared on a live bus.

    limit_ns: by how much its time may lag behind the clock before it does not keep up. sent: frames it sent.
    lasted_ns: how long it was there. behind: how often it did not keep up. worst_behind_ns: the longest lag.
    """

    limit_ns: int = CONTROL_NS
    sent: int = 0
    lasted_ns: int = 0
    behind: int = 0
    worst_behind_ns: int = 0

    def lag(self, ns: int) -> None:
        """Its time was `ns` behind the clock."""
        self.worst_behind_ns = max(self.worst_behind_ns, ns)
        self.behind += ns >= self.limit_ns

    def complaint(self) -> str | None:
        """What it says if it did not keep up."""
        if not self.behind:
            return None
        return (
            f"did not keep up: {self.behind} times {self.limit_ns / 1e6:g} ms or more behind, "
            f"{self.worst_behind_ns / 1e6:.1f} ms at worst"
        )


def serve(
    ecu: Ecu,
    bus: Bus,
    clock: Callable[[], int] = time.monotonic_ns,
    seconds: float | None = None,
    ready: Callable[[], None] | None = None,
    served: Served | None = None,
) -> Served:
    """Let `ecu` live on `bus` until interrupted, or for `seconds`; how it fared, kept up to date in `served`.

    Its virtual time follows the clock, except that after each frame it is given LOOK_NS at once: what it does
    with the frame takes virtual time, and waiting for that would only add to the time it takes to emulate it.
    """
    served = served or Served()

    def catch_up(t_ns: int) -> None:
        while (request := ecu.advance(t_ns)) is not None:
            if not bus.send(request.frame, SEND_S):
                why = bus.refusal and f": {bus.refusal}"
                raise BusError(f"ecu {ecu.name}: the bus took no frame for {SEND_S:g} s{why}")
            ecu.sent(request.handle, max(request.t_ns, t_ns))
            served.sent += 1

    catch_up(0)
    gc.freeze()  # what has been imported by now stays: no need to look through it again and again
    begun = clock()
    reached, arrived = 0, 0
    if ready:
        ready()
    while seconds is None or clock() - begun < seconds * 1e9:
        heard = bus.receive(IDLE_S)
        now = clock() - begun
        served.lasted_ns = now
        if heard is None:
            reached = max(reached, now)
            catch_up(reached)
        else:
            # Frames read late, after a pause of this process, still come one after the other.
            arrived = max(arrived, now - heard.age_ns)
            reached = max(reached, arrived)
            catch_up(reached)
            ecu.receive(heard.frame, arrived)
            # More frames than any bus carries may not push its time ever farther ahead.
            reached = max(reached, min(reached + LOOK_NS, now + AHEAD_NS))
            catch_up(reached)
        served.lag(clock() - begun - reached)
    return served


def rehearse(ecu: Ecu) -> None:
    """Let a spare `ecu` answer one input cycle, so that all that is compiled at first use is compiled."""
    ecu.advance(0)
    for message in Codec().messages():
        if NODE in message.senders:
            ecu.receive(Frame(message.id, bytes(message.length), message.extended), 0)
    while (request := ecu.advance(CONTROL_NS)) is not None:
        ecu.sent(request.handle, request.t_ns)
