"""The rig in virtual time: logger, bus and ECU brought together, event by event.

Belongs here: who acts when. Never: what a frame says (watch), what it means (verdict), a file, a clock.
"""

from collections.abc import Callable
from dataclasses import dataclass

from bench.bus.timed import Delivered, Disturbance, Load, TimedBus
from bench.errors import BusError
from bench.mdlog.logger import NODE, Schedule
from bench.watch import Watch
from targets.ecu import Ecu
from targets.errors import FirmwareFault

DRAIN_NS = 20_000_000
"""Past the last logger cycle the bus is watched on for two periods, so that the last answer is heard."""

MOST_WAITING = 64
"""Frames an ECU may have waiting for the bus: no controller queues that many, a runaway program does."""


@dataclass(frozen=True)
class Ride:
    """What happened on the bus during one lap.

    frames: every frame that went over the bus, in order. load: the bus's statistics. end_ns: when the rig
    stopped. failure: why it stopped early, None if it did not.
    """

    frames: list[Delivered]
    load: Load
    end_ns: int
    failure: str | None = None


def ride(
    schedule: Schedule,
    ecu: Ecu,
    watch: Watch,
    bitrate: int = 500_000,
    progress: Callable[[int], None] | None = None,
    disturbance: Disturbance | None = None,
) -> Ride:
    """Put the frames of `schedule` on a timed bus with `ecu` until both are done.

    watch sees every frame. progress is called with the time reached, ns, about once a second of the lap.
    disturbance: breaks frames on the bus.
    An ECU that faults, stops answering, floods the bus or asks for what no bus carries ends the ride early,
    with the reason in `Ride.failure`.
    """
    bus = TimedBus(bitrate, disturbance)
    bus.attach(ecu)
    frames: list[Delivered] = []
    source = iter(schedule)
    upcoming = next(source, None)
    end_ns = (int(schedule.t_ns[-1]) if len(schedule) else 0) + DRAIN_NS
    handle, now_ns, told_ns = 0, 0, 0
    failure = None
    try:
        while True:
            # The next instant at which anything outside the ECU happens; the ECU may ask for one before it.
            due_ns = upcoming[0] if upcoming else end_ns
            decision_ns = bus.next_decision_ns()
            now_ns = due_ns if decision_ns is None or decision_ns > due_ns else decision_ns
            request = ecu.advance(now_ns)
            if request is not None:
                bus.submit(request.t_ns, ecu.name, request.handle, request.frame)
                waiting = bus.waiting(ecu.name)
                if waiting > MOST_WAITING:
                    failure = f"ECU floods the bus: {waiting} frames wait at {now_ns / 1e9:.9g} s"
                    break
                continue
            if now_ns >= end_ns:
                break
            if upcoming and upcoming[0] == now_ns:
                failure = watch.cycle(now_ns)
                if failure:
                    break
            while upcoming and upcoming[0] == now_ns:
                bus.submit(now_ns, NODE, handle, upcoming[1])
                handle += 1
                upcoming = next(source, None)
            delivered = bus.step(now_ns)
            if delivered is None:
                continue
            frames.append(delivered)
            if delivered.node != NODE:
                watch.heard(delivered.frame, now_ns)
            if progress is not None and now_ns - told_ns >= 1_000_000_000:
                told_ns = now_ns
                progress(now_ns)
    except (FirmwareFault, BusError) as fault:
        failure = f"{fault.side}: {fault}"
    else:
        failure = failure or watch.unanswered(now_ns)
    if failure and failure.startswith(Watch.OVERRUN):
        where = ecu.where()
        failure += f"; {where}" if where else ""
    return Ride(frames, bus.load(now_ns), now_ns, failure)
