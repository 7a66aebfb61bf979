"""The MDLog data logger: which frames it hands to the bus during a lap, and when.

Belongs here: sampling, the messages of the DBC that node MDLOG sends, their payloads. Never: a bit's place
(the codec's), when a frame really travels (the bus's), a fault (it is in the codes already).

The thesis's logger records at 1 kHz (section II.5) and puts the signals, altered by the fault, on the bus
(section V.6.1); 100 Hz is the control loop's rate (section III.2).
FIDELITY: a sample-and-hold without the logger's own filter, jitter or latency.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import gcd

import numpy as np
from numpy.typing import NDArray

from bench.codec import Codec, Message
from bench.errors import LapError
from bench.sensors.codes import Codes
from bench.sensors.transducers import BY_CHANNEL, TRANSDUCERS
from targets.ecu import Frame

NODE = "MDLOG"
"""The logger's name in the DBC and on the bus."""

_MS = 1_000_000
_SECOND_NS = 1_000_000_000
_AT_ONCE = 512  # rows turned into frames at a time


@dataclass(frozen=True)
class Schedule:
    """The frames of one lap, in the order (t_ns, identifier); t_ns is when the logger asks to send one.

    t_ns: int64 (frames,). ids: uint32 (frames,). extended: bool (frames,). lengths: uint8 (frames,).
    payload: uint8 (frames, 8), zero beyond a frame's length. cycle: int64 (frames,), the logger's cycle, of
    cycle_ns each.
    unsent: message name -> the channels for want of which it is not sent.
    """

    t_ns: NDArray[np.int64]
    ids: NDArray[np.uint32]
    extended: NDArray[np.bool_]
    lengths: NDArray[np.uint8]
    payload: NDArray[np.uint8]
    cycle: NDArray[np.int64]
    cycle_ns: int
    unsent: Mapping[str, tuple[str, ...]]

    def __len__(self) -> int:
        return len(self.t_ns)

    def __iter__(self) -> Iterator[tuple[int, Frame]]:
        """Every (t_ns, frame), in order."""
        return self.rows()

    def rows(self, begin: int = 0) -> Iterator[tuple[int, Frame]]:
        """The (t_ns, frame) from row `begin` on, in order; the first comes at once however many follow."""
        for at in range(begin, len(self), _AT_ONCE):
            part = slice(at, at + _AT_ONCE)
            data = self.payload[part].tobytes()
            columns = (column[part].tolist() for column in (self.t_ns, self.ids, self.lengths, self.extended))
            for row, (t_ns, identifier, length, extended) in enumerate(zip(*columns, strict=True)):
                yield t_ns, Frame(identifier, data[8 * row : 8 * row + length], extended)


def schedule(codes: Codes, codec: Codec, rate_hz: int | None = None) -> Schedule:
    """The frames of every cyclic message of node MDLOG whose channels `codes` all has.

    A message of period P is handed to the bus at 0, P, 2P ... to the last sample, so that messages due at one
    instant compete by priority; each signal is its sensor's latest code at or before it. `alive` counts the
    logger's cycles, as long as the periods' greatest common divisor, modulo what its bits hold.

    rate_hz: of every message, in place of the DBC's. Raises LapError for one whose period is not a whole
    number of nanoseconds.
    """
    messages = [m for m in codec.messages() if NODE in m.senders and m.cycle_ms > 0]
    missing = {m.name: _missing(m, codes) for m in messages}
    given_ns = None if rate_hz is None else _period_ns(rate_hz)
    cycle_ns = given_ns or _MS * gcd(*(m.cycle_ms for m in messages))
    parts = [
        _frames(message, codes, codec, given_ns or message.cycle_ms * _MS, cycle_ns)
        for message in messages
        if not missing[message.name]
    ]
    columns = [np.concatenate(column) for column in zip(*parts, strict=True)] if parts else _nothing()
    order = np.lexsort((columns[1], columns[0]))
    t_ns, ids, extended, lengths, payload, cycle = (column[order] for column in columns)
    unsent = {name: channels for name, channels in missing.items() if channels}
    return Schedule(t_ns, ids, extended, lengths, payload, cycle, cycle_ns, unsent)


def sampled_codes(codes: Codes, rate_hz: int) -> dict[str, NDArray[np.int32]]:
    """Codes int32 (cycles,) of every sensor at 0, 1/rate, 2/rate ... s: the latest at or before each instant.

    Raises LapError for a rate whose period is not a whole number of nanoseconds.
    """
    latest = _latest(codes, _period_ns(rate_hz))[1]
    return {sensor: array[latest] for sensor, array in codes.codes.items()}


def sampled(codes: Codes, rate_hz: int = 100) -> dict[str, NDArray[np.float64]]:
    """Channel name -> float64 (cycles,): the values a receiver decodes from the frames, at `rate_hz`.

    What a network is to be trained on, since it is what the ECU sees. Raises LapError as `sampled_codes`.
    """
    return {
        TRANSDUCERS[sensor].channel: TRANSDUCERS[sensor].to_physical(array)
        for sensor, array in sampled_codes(codes, rate_hz).items()
    }


def _period_ns(rate_hz: int) -> int:
    if rate_hz <= 0 or _SECOND_NS % rate_hz:
        raise LapError(f"rate {rate_hz} Hz has no period of whole nanoseconds")
    return _SECOND_NS // rate_hz


def _latest(codes: Codes, period_ns: int) -> tuple[NDArray[np.int64], NDArray[np.intp]]:
    """The instants 0, P, 2P ... to the last sample, and at each the index of the latest sample."""
    instants = np.arange(0, int(codes.t_ns[-1]) + 1, period_ns, dtype=np.int64)
    return instants, np.searchsorted(codes.t_ns, instants, side="right") - 1


def _missing(message: Message, codes: Codes) -> tuple[str, ...]:
    """The signals of `message`, beside its counter, that no sensor in `codes` gives."""
    return tuple(
        name
        for name in message.signals
        if name != "alive" and (name not in BY_CHANNEL or BY_CHANNEL[name].sensor not in codes.codes)
    )


def _frames(
    message: Message, codes: Codes, codec: Codec, period_ns: int, cycle_ns: int
) -> tuple[NDArray, ...]:
    """The columns of a Schedule for one message."""
    t_ns, latest = _latest(codes, period_ns)
    cycle = t_ns // cycle_ns
    raw = {
        name: cycle % (signal.raw_max + 1)
        if name == "alive"
        else codes.codes[BY_CHANNEL[name].sensor][latest]
        for name, signal in message.signals.items()
    }
    frames = len(t_ns)
    payload = np.zeros((frames, 8), dtype=np.uint8)
    payload[:, : message.length] = codec.pack(message.name, raw)
    return (
        t_ns,
        np.full(frames, message.id, dtype=np.uint32),
        np.full(frames, message.extended, dtype=np.bool_),
        np.full(frames, message.length, dtype=np.uint8),
        payload,
        cycle,
    )


def _nothing() -> list[NDArray]:
    return [
        np.zeros(0, np.int64),
        np.zeros(0, np.uint32),
        np.zeros(0, np.bool_),
        np.zeros(0, np.uint8),
        np.zeros((0, 8), np.uint8),
        np.zeros(0, np.int64),
    ]
