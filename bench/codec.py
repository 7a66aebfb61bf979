"""The DBC codec: physical values to raw ones, raw ones to payload bytes, and back, many frames at once.

Belongs here: where the bits go, as the DBC file says, and one rounding rule. A physical value becomes
rint((value - offset) / scale), half to even in float64, and is then saturated to what the signal's bits can
carry, so that packing never overflows; firmware that packs the same layout must round alike.
Never: which message is sent when, what a signal means.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bench.errors import BusError
from bench.quiet import quiet
from dbc import MOTORCYCLE

_MAX_BITS = 52
"""Longest signal handled: float64 carries its every raw value exactly, int64 without a thought of sign."""


@dataclass(frozen=True)
class Signal:
    """Where one signal lies in its message and what a bit of it is worth.

    shift: bits right of it when the payload's bytes, padded to 8, are read as one integer of its byte order.
    raw_min, raw_max: what its bits can carry. low, high: the physical limits of the DBC, None if it has none.
    names: raw value -> what the DBC calls it, empty if it calls none.
    """

    name: str
    shift: int
    length: int
    little_endian: bool
    signed: bool
    scale: float
    offset: float
    raw_min: int
    raw_max: int
    low: float | None
    high: float | None
    unit: str
    names: Mapping[int, str] = field(default_factory=dict)

    def to_raw(self, physical: ArrayLike) -> NDArray[np.int64]:
        """Raw int64 values of `physical`, same shape: rounded half to even, saturated to the signal's bits.

        Raises BusError for NaN; no other value is refused.
        """
        values = np.asarray(physical, dtype=np.float64)
        if np.isnan(values).any():
            raise BusError(f"signal {self.name} is nan: there is no raw value for it")
        with np.errstate(over="ignore"):  # infinity saturates like any other value
            raw = np.rint((values - self.offset) / self.scale)
        return np.clip(raw, self.raw_min, self.raw_max).astype(np.int64)

    def to_physical(self, raw: ArrayLike) -> NDArray[np.float64]:
        """Physical float64 values of `raw`, same shape."""
        return np.asarray(raw, dtype=np.float64) * self.scale + self.offset


@dataclass(frozen=True)
class Message:
    """One message of the DBC; `length` in bytes, `cycle_ms` its GenMsgCycleTime (0: not cyclic)."""

    name: str
    id: int
    extended: bool
    length: int
    senders: tuple[str, ...]
    cycle_ms: int
    signals: Mapping[str, Signal]


class Codec:
    """The messages of one DBC file; two codecs of the same text share one parse.

    Messages that are multiplexed, longer than 8 bytes, carry float signals or share their name or identifier
    are refused when asked for; `refused` says which and why, by name.
    Raises BusError for a file that cannot be read and for messages and signals it does not have.
    """

    def __init__(self, path: Path = MOTORCYCLE) -> None:
        self.path = Path(path)
        try:
            # what DBC editors write; a stray byte in a comment is no reason to refuse the layout
            text = self.path.read_text(encoding="cp1252", errors="replace")
        except OSError as error:
            raise BusError(f"{path}: {error.strerror}") from None
        self._messages, self.refused = _parse(text, str(path))
        self._by_id = {(message.id, message.extended): message for message in self._messages.values()}

    def messages(self) -> tuple[Message, ...]:
        """All messages that can be encoded, in the order of the file."""
        return tuple(self._messages.values())

    def message(self, key: str | int, extended: bool = False) -> Message:
        """The message of that name, or of that identifier (11 bits, or 29 if `extended`)."""
        if isinstance(key, str):
            found = self._messages.get(key)
            if key in self.refused:
                raise BusError(f"{self.path}: message {key} {self.refused[key]}")
        else:
            found = self._by_id.get((key, extended))
        if found is None:
            shown = key if isinstance(key, str) else f"{key:#x}"
            known = ", ".join(f"{m.name} ({m.id:#x})" for m in self._messages.values())
            raise BusError(f"{self.path}: no message {shown}; the known ones are {known}")
        return found

    def pack(self, name: str, raw: Mapping[str, ArrayLike]) -> NDArray[np.uint8]:
        """Payloads uint8 (frames, length) of message `name` from raw integers (frames,) per signal.

        Every signal must be there; a scalar holds for all frames. Raw values beyond a signal's bits saturate.
        """
        message = self.message(name)
        _same_names(message, raw)
        columns = {key: np.atleast_1d(np.asarray(value)) for key, value in raw.items()}
        frames = np.broadcast_shapes(*(column.shape for column in columns.values()))
        # one integer of 8 bytes per byte order; signals of both orders meet when the bytes are joined
        little: NDArray[np.uint64] | None = None
        big: NDArray[np.uint64] | None = None
        for key, signal in message.signals.items():
            bits = _bits(signal, columns[key])
            if signal.little_endian:
                little = _join(little, bits, frames)
            else:
                big = _join(big, bits, frames)
        payload = np.zeros((*frames, 8), dtype=np.uint8)
        if little is not None:
            payload |= little.astype("<u8", copy=False).view(np.uint8).reshape(*frames, 8)
        if big is not None:
            payload |= big.astype(">u8").view(np.uint8).reshape(*frames, 8)
        return np.ascontiguousarray(payload[:, : message.length])

    def encode(self, name: str, physical: Mapping[str, ArrayLike]) -> NDArray[np.uint8]:
        """Payloads uint8 (frames, length) of message `name` from physical values (frames,) per signal."""
        message = self.message(name)
        _same_names(message, physical)
        return self.pack(name, {key: message.signals[key].to_raw(value) for key, value in physical.items()})

    def unpack(self, name: str, payload: NDArray[np.uint8]) -> dict[str, NDArray[np.int64]]:
        """Raw int64 (frames,) per signal of message `name` from its payloads uint8 (frames, bytes).

        Raises BusError for payloads shorter than the message.
        """
        message = self.message(name)
        if payload.ndim != 2 or payload.shape[1] < message.length:
            raise _short(message, payload.shape[-1])
        padded = np.zeros((len(payload), 8), dtype=np.uint8)
        padded[:, : message.length] = payload[:, : message.length]
        little = padded.view("<u8")[:, 0].astype(np.uint64)
        big = padded.view(">u8")[:, 0].astype(np.uint64)
        raws = {}
        for key, signal in message.signals.items():
            word = little if signal.little_endian else big
            raw = ((word >> np.uint64(signal.shift)) & np.uint64((1 << signal.length) - 1)).astype(np.int64)
            if signal.signed:
                raw[raw > signal.raw_max] -= 1 << signal.length
            raws[key] = raw
        return raws

    def decode_all(self, name: str, payload: NDArray[np.uint8]) -> dict[str, NDArray[np.float64]]:
        """Physical float64 (frames,) per signal of message `name` from its payloads uint8 (frames, bytes)."""
        signals = self.message(name).signals
        return {key: signals[key].to_physical(raw) for key, raw in self.unpack(name, payload).items()}

    def decode(self, name: str, data: bytes) -> dict[str, float]:
        """Physical value per signal of one payload of message `name`.

        Raises BusError for a payload shorter than the message.
        """
        message = self.message(name)
        if len(data) < message.length:
            raise _short(message, len(data))
        padded = data[: message.length].ljust(8, b"\0")
        little, big = int.from_bytes(padded, "little"), int.from_bytes(padded, "big")
        values = {}
        for key, signal in message.signals.items():
            raw = ((little if signal.little_endian else big) >> signal.shift) & ((1 << signal.length) - 1)
            if raw > signal.raw_max:
                raw -= 1 << signal.length
            values[key] = raw * signal.scale + signal.offset
        return values


def _bits(signal: Signal, raw: NDArray) -> NDArray[np.uint64]:
    """The signal's bits at their place in the 8-byte integer, uint64, same shape."""
    if raw.dtype.kind not in "iub":
        raise BusError(f"signal {signal.name}: raw values are integers, not {raw.dtype}")
    # two reductions cost less than an unconditional clip, and healthy codes never need it
    if raw.size and (raw.min() < signal.raw_min or raw.max() > signal.raw_max):
        raw = np.clip(raw, signal.raw_min, signal.raw_max)
    bits = raw.astype(np.int64).view(np.uint64)
    if signal.signed:
        bits &= np.uint64((1 << signal.length) - 1)
    bits <<= np.uint64(signal.shift)
    return bits


def _join(word: NDArray[np.uint64] | None, bits: NDArray[np.uint64], shape: tuple[int, ...]) -> NDArray:
    if word is None:
        return bits if bits.shape == shape else np.broadcast_to(bits, shape).copy()
    word |= bits
    return word


def _same_names(message: Message, given: Mapping[str, object]) -> None:
    missing = [key for key in message.signals if key not in given]
    unknown = [key for key in given if key not in message.signals]
    if missing or unknown:
        wrong = f"lacks {', '.join(missing)}" if missing else f"has no signal {', '.join(unknown)}"
        raise BusError(f"message {message.name} {wrong}; its signals are {', '.join(message.signals)}")


def _short(message: Message, length: int) -> BusError:
    return BusError(f"message {message.name} has {message.length} bytes; a payload of {length} is too short")


@lru_cache(maxsize=8)
def _parse(text: str, path: str) -> tuple[dict[str, Message], dict[str, str]]:
    """The messages of a DBC text, and those that cannot be handled with the reason why."""
    import cantools

    try:
        with quiet("cantools"):  # what it warns of is refused below, by name
            database = cantools.database.load_string(text, database_format="dbc", strict=False)
    except (cantools.database.Error, ValueError) as error:
        raise BusError(f"{path}: not a DBC file: {' '.join(str(error).split())}") from None
    messages: dict[str, Message] = {}
    refused: dict[str, str] = {}
    bearers: dict[tuple[int, bool], list[str]] = {}
    for message in database.messages:
        bearers.setdefault((message.frame_id, message.is_extended_frame), []).append(message.name)
    for message in database.messages:
        # cantools lets the later of two answer for both
        twins = bearers[message.frame_id, message.is_extended_frame]
        reason = _why_not(message)
        if len(twins) > 1:
            reason = f"shares the identifier {message.frame_id:#x}: {' and '.join(twins)}"
        elif message.name in messages or message.name in refused:
            messages.pop(message.name, None)
            reason = "is defined twice"
        if reason:
            refused[message.name] = reason
            continue
        messages[message.name] = Message(
            name=message.name,
            id=message.frame_id,
            extended=message.is_extended_frame,
            length=message.length,
            senders=tuple(message.senders),
            cycle_ms=message.cycle_time or 0,
            signals={signal.name: _signal(signal) for signal in message.signals},
        )
    return messages, refused


def _why_not(message) -> str:  # type: ignore[no-untyped-def]  # cantools is imported where it is used
    if message.length > 8:
        return f"has {message.length} bytes, more than a classic frame carries"
    if message.is_multiplexed():
        return "is multiplexed"
    names = [signal.name for signal in message.signals]
    for signal in message.signals:
        if names.count(signal.name) > 1:
            return f"defines the signal {signal.name} twice"
        if signal.is_float:
            return f"carries the float signal {signal.name}"
        if signal.length > _MAX_BITS:
            return f"carries the signal {signal.name} of {signal.length} bits, more than {_MAX_BITS}"
        shift, spare = _shift(signal), 64 - 8 * message.length
        # unused bytes are to the left of an Intel signal's integer, to the right of a Motorola one's
        low, high = (0, 64 - spare) if signal.byte_order == "little_endian" else (spare, 64)
        if not low <= shift <= high - signal.length:
            return f"carries the signal {signal.name} beyond its end"
    return ""


def _shift(signal) -> int:  # type: ignore[no-untyped-def]  # as above
    if signal.byte_order == "little_endian":
        return int(signal.start)
    # Motorola: `start` is the most significant bit, counted within its byte from the right
    byte, bit = divmod(signal.start, 8)
    return 64 - (8 * byte + 7 - bit) - int(signal.length)


def _signal(signal) -> Signal:  # type: ignore[no-untyped-def]  # as above
    half = 1 << (signal.length - 1)
    return Signal(
        name=signal.name,
        shift=_shift(signal),
        length=signal.length,
        little_endian=signal.byte_order == "little_endian",
        signed=signal.is_signed,
        scale=float(signal.scale),
        offset=float(signal.offset),
        raw_min=-half if signal.is_signed else 0,
        raw_max=half - 1 if signal.is_signed else 2 * half - 1,
        low=None if signal.minimum is None else float(signal.minimum),
        high=None if signal.maximum is None else float(signal.maximum),
        unit=signal.unit or "",
        names={int(raw): str(name) for raw, name in (signal.choices or {}).items()},
    )
