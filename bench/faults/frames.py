"""Faults on the bus: what each kind does to the frames that the logger hands to it.

Belongs here: the kinds. Never: when a fault acts and what is known of it (`bus`), the timed bus itself.

Each is causal: a row depends on the rows at or before it, and on the time since the command.
FIDELITY: frames are struck as the logger hands them over. A corrupted one has a CRC that fits, as one that
was broken in its sender's memory; a lost one leaves no trace on the wire, as if its sender had never asked; a
babbling node's frames wait in the logger's own queue.
"""

from dataclasses import replace

import numpy as np

from bench.faults.kind import SEED, BusKind, Kind, Number, always, byte
from bench.faults.striking import Striking, Struck, taken
from bench.mdlog.logger import Schedule

ALIVE = "alive"
"""The signal that counts a message's cycles."""

_RATE = Number(0.2, 0.0, 1.0)
NO_CYCLE = -1
"""Cycle of a frame that is another node's."""


def _frame_loss(fault: Striking) -> Struck:
    return Struck(lost=fault.drawn("loss"))


def _frame_corruption(fault: Striking) -> Struck:
    rows = fault.drawn("corruption")
    bits = 8 * fault.schedule.lengths[rows].astype(np.int64)
    burst = np.minimum(int(fault.params["bits"]), bits)
    first = np.floor(fault.random("place").random(len(rows)) * (bits - burst + 1)).astype(np.int64)
    bit = np.arange(64)
    flipped = (bit >= first[:, None]) & (bit < (first + burst)[:, None])
    payload = fault.schedule.payload.copy()
    payload[rows] ^= np.packbits(flipped, axis=1)
    return Struck(payload=payload)


def _frame_repeat(fault: Striking) -> Struck:
    rows, plan = fault.drawn("repeat"), fault.schedule
    again = taken(plan, rows)
    again_ns = plan.t_ns[rows] + round(float(fault.params["after"]) * 1e9)
    # the logger is switched off after its last frame
    kept = again_ns <= fault.last_ns
    return Struck(added=replace(taken(again, np.flatnonzero(kept)), t_ns=again_ns[kept]))


def _stuck_counter(fault: Striking) -> Struck:
    plan, payload = fault.schedule, fault.schedule.payload.copy()
    for identifier in np.unique(plan.ids[fault.rows]):
        rows = fault.rows[plan.ids[fault.rows] == identifier]
        message = fault.codec.message(int(identifier), bool(plan.extended[rows[0]]))
        if ALIVE not in message.signals:
            continue
        before = np.flatnonzero((plan.ids[: rows[0]] == identifier) & (plan.cycle[: rows[0]] >= 0))
        last = before[-1] if before.size else rows[0]
        stuck = fault.codec.unpack(message.name, plan.payload[[last]])[ALIVE][0]
        raw = fault.codec.unpack(message.name, plan.payload[rows])
        payload[rows, : message.length] = fault.codec.pack(message.name, {**raw, ALIVE: stuck})
    return Struck(payload=payload)


def _babbling(fault: Striking) -> Struck:
    period_ns = 1e9 / float(fault.params["rate"])
    count = int(np.ceil((fault.end_ns - fault.start_ns) / period_ns))
    t_ns = fault.start_ns + np.floor(np.arange(count) * period_ns).astype(np.int64)
    t_ns = t_ns[t_ns < fault.end_ns]
    count, length = len(t_ns), int(fault.params["length"])
    return Struck(
        added=Schedule(
            t_ns,
            np.full(count, int(fault.params["id"]), np.uint32),
            np.zeros(count, np.bool_),
            np.full(count, length, np.uint8),
            np.zeros((count, 8), np.uint8),
            np.full(count, NO_CYCLE, np.int64),
            fault.schedule.cycle_ns,
            {},
        )
    )


def _bus_off(fault: Striking) -> Struck:
    return Struck(lost=fault.rows)


KINDS: dict[str, Kind] = {
    "frame_loss": BusKind(
        strike=_frame_loss,
        about="each frame is lost with this probability",
        where="message",
        params={"rate": _RATE, "seed": SEED},
        called=always(None),
        ftb=byte(0x87),
    ),
    "frame_corruption": BusKind(
        strike=_frame_corruption,
        about="in each frame, with this probability, a burst of so many payload bits is inverted",
        where="message",
        params={"rate": _RATE, "bits": Number(1.0, 1.0, 64.0, whole=True), "seed": SEED},
        called=always(None),
        ftb=byte(0x81),
    ),
    "frame_repeat": BusKind(
        strike=_frame_repeat,
        about="each frame is sent once more with this probability, so much later",
        where="message",
        params={"rate": _RATE, "after": Number(0.001, 0.0, 10.0, unit="s"), "seed": SEED},
        called=always(None),
        ftb=byte(0x82),
    ),
    "stuck_counter": BusKind(
        strike=_stuck_counter,
        about="the alive counter stays at its last value",
        where="message",
        params={},
        called=always(None),
        ftb=byte(0x82),
    ),
    "babbling": BusKind(
        strike=_babbling,
        about="a node sends this identifier so many times a second: the lowest wins every arbitration",
        where="bus",
        params={
            "rate": Number(3000.0, 1.0, 20_000.0, unit="1/s"),
            "id": Number(0.0, 0.0, 2047.0, whole=True),
            "length": Number(8.0, 0.0, 8.0, whole=True, unit="bytes"),
        },
        called=always(None),
        ftb=byte(None),
    ),
    "bus_off": BusKind(
        strike=_bus_off,
        lasts_ns=lambda params: round(float(params["recovery"]) * 1e9),
        about="the logger's controller is off the bus until the fault ends and it has recovered, "
        "128 times 11 bits later",
        where="bus",
        params={"recovery": Number(0.002816, 0.0, 60.0, unit="s")},
        called=always(None),
        ftb=byte(0x88),
    ),
}
"""The kinds that act on frames."""
