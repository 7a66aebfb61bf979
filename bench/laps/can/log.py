"""CAN logs: from frames to channels through a DBC, and from a lap to the frames that the logger would send.

Belongs here: which message and signal is which channel, and what may be missing. Never: a log's bytes; each
format has its own module, which hands over `Frames`, and the codec knows where the bits lie.
"""

import errno
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.codec import Codec, Message, Signal
from bench.errors import LapError, RecordError
from bench.laps.can.frames import FD, MOST_BYTES, Frames
from bench.laps.channel_map import ChannelMap, Row
from bench.laps.lap import Lap
from bench.laps.recording import Recording, Track
from dbc import CHANNELS, MOTORCYCLE

Found = tuple[Row, Message, Signal]


def recording(path: Path, frames: Frames, channel_map: ChannelMap | None) -> Recording:
    """The channels of a log: those the map names, or without one all CHANNELS that motorcycle.dbc carries.

    Each has the times of its own message's frames. Remote, error and CAN FD frames and identifiers that are
    not asked for are passed over; a message's frames shorter than it are damage.
    FIDELITY: a mapped message that travels in CAN FD frames is named, not read.
    Raises LapError naming what the DBC or the log lacks, BusError for a DBC or a message the codec refuses.
    """
    codec = Codec(MOTORCYCLE if channel_map is None or channel_map.dbc is None else channel_map.dbc)
    wanted = _own(codec) if channel_map is None else [_found(codec, row) for row in channel_map.rows.values()]
    damage = list(frames.damage)
    tracks: dict[str, Track] = {}
    for message, bus, rows in _by_message(wanted):
        mine = _select(frames, message, bus, str(path), channel_map, damage)
        raw = codec.unpack(message.name, frames.payload[mine]) if mine.size else {}
        for row, signal in rows if mine.size else ():
            values = row.convert(signal.to_physical(raw[signal.name]), signal.unit, str(codec.path))
            if not np.isfinite(values).all():
                raise LapError(f"{codec.path}: signal {row.signal}: scale {signal.scale:g} gives no number")
            tracks[row.channel] = Track(frames.t_ns[mine], values)
    if not tracks:
        messages = ", ".join(dict.fromkeys(f"{m.name} ({m.id:#x})" for _, m, _ in wanted))
        raise LapError(
            f"{path}: no frame of {messages}; {_identifiers(frames)}; a channel map says what is what"
        )
    rate_hz = None if channel_map is None else channel_map.rate_hz
    ordered = {name: tracks[name] for name in CHANNELS if name in tracks}
    return Recording(str(path), path.name, ordered, common=False, rate_hz=rate_hz, damage=tuple(damage))


def content(path: Path) -> bytes:
    """A log's bytes; LapError if it is longer than MOST_BYTES."""
    size = path.stat().st_size
    if size > MOST_BYTES:
        raise LapError(f"{path}: {size} bytes; a log is read up to {MOST_BYTES}: cut it to the lap")
    return path.read_bytes()


def write(lap: Lap, path: Path, suffix: str) -> None:
    """Write the frames that the logger sends during `lap`, with ideal sensors, each at its due time.

    suffix: the recorder's format. Raises LapError naming the channels that no message would carry.
    """
    from bench.mdlog.logger import schedule
    from bench.recorder import record
    from bench.sensors.codes import acquire

    codec = Codec()
    sent = schedule(acquire(lap), codec)
    present = set(sent.ids.tolist())
    carried = {name for m in codec.messages() if m.id in present for name in m.signals}
    lost = [name for name in lap.channels if name not in carried]
    if lost:
        why = "; ".join(
            f"message {name} also wants {', '.join(missing)}"
            for name, missing in sent.unsent.items()
            if any(channel in codec.message(name).signals for channel in lost)
        )
        raise LapError(f"{lap.source or 'lap'}: {', '.join(lost)} would be lost: {why}")
    # the recorder goes by the suffix, and what is to become a lap file has none of its own yet
    whole = path.with_suffix(suffix)
    try:
        record(whole, ((t_ns, frame, "MDLOG") for t_ns, frame in sent))
        whole.replace(path)
    except RecordError as error:
        raise OSError(errno.EIO, str(error).rpartition(": ")[2]) from None
    finally:
        whole.unlink(missing_ok=True)


def _own(codec: Codec) -> list[Found]:
    return [
        (Row(name, f"{message.name}.{name}"), message, signal)
        for message in codec.messages()
        for name, signal in message.signals.items()
        if name in CHANNELS
    ]


def _found(codec: Codec, row: Row) -> Found:
    name, _, signal = row.signal.rpartition(".")
    if not name or not signal:
        raise LapError(f"channels.{row.channel}: signal {row.signal!r} is not MESSAGE.SIGNAL of a DBC")
    names = [message.name for message in codec.messages()]
    if name not in names and name not in codec.refused:
        raise LapError(
            f"{codec.path}: no message {name} for {row.channel}; its messages are {', '.join(names)}"
        )
    message = codec.message(name)
    if signal not in message.signals:
        known = ", ".join(message.signals) or "none"
        raise LapError(f"{codec.path}: message {name} has no signal {signal}; its signals are {known}")
    return row, message, message.signals[signal]


def _by_message(wanted: list[Found]) -> Iterator[tuple[Message, int | None, list[tuple[Row, Signal]]]]:
    """The rows of each message and bus together, so that its frames are looked for once."""
    groups: dict[tuple[str, int | None], list[tuple[Row, Signal]]] = {}
    messages: Mapping[str, Message] = {message.name: message for _, message, _ in wanted}
    for row, message, signal in wanted:
        groups.setdefault((message.name, row.bus), []).append((row, signal))
    for (name, bus), rows in groups.items():
        yield messages[name], bus, rows


def _select(
    frames: Frames,
    message: Message,
    bus: int | None,
    where: str,
    channel_map: ChannelMap | None,
    damage: list[str],
) -> NDArray[np.intp]:
    """The rows of `frames` that carry `message` on `bus`; what cannot be used of them is added to `damage`.

    Raises LapError if there is none and the map asked for it.
    """
    label = f"{message.name} ({message.id:#x})"
    there = (frames.id == message.id) & (frames.extended == message.extended)
    buses = np.unique(frames.bus[there])
    if bus is not None:
        there &= frames.bus == bus
    classic = there & (frames.flags == 0)
    short = np.flatnonzero(classic & (frames.length < message.length))
    mine = np.flatnonzero(classic & (frames.length >= message.length))
    notes = []
    fd = np.count_nonzero(there & (frames.flags & FD != 0))
    if fd:
        notes.append(f"{label}: {fd} CAN FD frames passed over")
    if short.size:
        at, length = frames.at[short[0]], frames.length[short[0]]
        notes.append(
            f"{label}: {short.size} frames shorter than its {message.length} bytes passed over, "
            f"the first at {frames.counted} {at} with {length}"
        )
    if bus is None and len(buses) > 1:
        notes.append(
            f"{label} is on buses {_list(buses)}, all of them read; `bus` in a channel map picks one"
        )
    if not mine.size and channel_map is not None:
        on = "" if bus is None else f" on bus {bus}"
        if notes:
            why = "; ".join(notes)
        elif buses.size:
            why = f"it is on bus {_list(buses)}" if buses.min() >= 0 else "the log names no bus"
        else:
            why = _identifiers(frames)
        raise LapError(f"{where}: no frame of {label}{on}: {why}")
    damage += notes
    return mine


def _identifiers(frames: Frames) -> str:
    """What identifiers a log holds, for a message."""
    known, counts = np.unique(frames.id, return_counts=True)
    often = [f"{known[k]:#x}" for k in np.argsort(-counts, kind="stable")[:8]]
    dots = ", ..." if len(known) > len(often) else ""
    return f"its {len(frames)} frames bear {', '.join(often)}{dots}"


def _list(buses: NDArray[np.int32]) -> str:
    return ", ".join("unnamed" if bus < 0 else str(bus) for bus in buses.tolist())
