"""CAN frames as arrays: the one form in which every log hands over what it holds.

Belongs here: the arrays, what counts as a frame, how much damage a log may have. Never: a format, a signal.
"""

from array import array
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bench.errors import LapError

if TYPE_CHECKING:
    import can

REMOTE, ERROR, FD = 1, 2, 4
"""Bits of `Frames.flags`; a frame without any is a classic data frame."""

MOST_BYTES = 1 << 30
"""Longest log read, in bytes, unpacked: some 20 million frames, four hours of a busy bus."""

NAMED = 3
"""Positions of damage named one by one; the rest are counted."""

_FARTHEST_S = 9.2e9  # int64 nanoseconds
_LAST_BUS = 0xFFFF
_FINE_S = 2.0**22  # beyond, float64 seconds are coarser than a nanosecond


@dataclass(frozen=True)
class Frames:
    """The frames of one log in the order of the file.

    t_ns: int64 (frames,), any origin. id: uint32 (frames,). extended: bool (frames,). flags: uint8 (frames,).
    length: uint8 (frames,), data bytes, for remote frames those asked for. payload: uint8 (frames, 8), the
    first eight bytes, zero beyond the length. bus: int32 (frames,), -1 where the log names none.
    at: int64 (frames,), the position in the file, in what `counted` says. damage: as in a Recording.
    """

    t_ns: NDArray[np.int64]
    id: NDArray[np.uint32]
    extended: NDArray[np.bool_]
    flags: NDArray[np.uint8]
    length: NDArray[np.uint8]
    payload: NDArray[np.uint8]
    bus: NDArray[np.int32]
    at: NDArray[np.int64]
    counted: str = "line"
    damage: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.t_ns)

    def rows(self, which: slice | NDArray[np.intp], damage: tuple[str, ...]) -> "Frames":
        """The frames at `which`, with this damage."""
        return Frames(
            self.t_ns[which],
            self.id[which],
            self.extended[which],
            self.flags[which],
            self.length[which],
            self.payload[which],
            self.bus[which],
            self.at[which],
            self.counted,
            damage,
        )


class Damage:
    """What was skipped in a log because it is no frame: the first few by position, the others by number."""

    def __init__(self, where: str, counted: str = "line") -> None:
        self.where, self.counted = where, counted
        self.count = 0
        self.named: list[str] = []

    def add(self, at: int, what: str, good: int) -> None:
        """Note that the thing at `at` is no frame; LapError if nothing `good` came before it."""
        if good == 0:
            raise LapError(f"{self.where}: {self.counted} {at}: {what}")
        self.count += 1
        if len(self.named) < NAMED:
            self.named.append(f"{self.counted} {at}: {what}")

    def lines(self, good: int) -> tuple[str, ...]:
        """The lines for a Recording; LapError if more than one in a hundred is damaged, and more than one."""
        if self.count > max(1, good // 100):
            raise LapError(
                f"{self.where}: {self.named[0]}; {self.count} {self.counted}s like it among {good} frames"
            )
        more = self.count - len(self.named)
        return (*self.named, *((f"and {more} more {self.counted}s like these",) if more else ()))


def shown(text: str) -> str:
    """A piece of a file as it may stand in a message: one line, printable, short."""
    return repr(text if len(text) <= 60 else text[:60] + "...")


def nanoseconds(t_s: NDArray[np.float64]) -> NDArray[np.int64]:
    """Whole nanoseconds of float64 seconds; of times since 1970 whole microseconds, which is what they carry.

    FIDELITY: a log that python-can hands over in seconds since 1970 keeps microseconds only.
    """
    fine = np.rint(t_s * 1e9)
    return np.where(np.abs(t_s) < _FINE_S, fine, np.rint(t_s * 1e6) * 1e3).astype(np.int64)


def gather(
    messages: "Iterable[tuple[int, can.Message]]",
    damage: Damage,
    shift: int = 0,
    tail: Callable[[], tuple[str, ...]] = tuple,
) -> Frames:
    """The frames of python-can's messages, each with its position; what is no CAN frame is damage.

    shift: what to add to python-can's channel number to get the one that the file shows. tail: damage found
    beside, asked for when the messages are through.
    Raises LapError if there is nothing, or too much of it is damaged.
    """
    t_s, identifiers, buses, position = array("d"), array("I"), array("i"), array("q")
    extended, flags, lengths, payload = bytearray(), bytearray(), bytearray(), bytearray()
    for at, message in messages:
        wrong = _wrong(message)
        if wrong:
            damage.add(at, wrong, len(t_s))
            continue
        t_s.append(message.timestamp)
        identifiers.append(message.arbitration_id & 0x1FFFFFFF)
        extended.append(message.is_extended_id)
        flags.append(REMOTE * message.is_remote_frame | ERROR * message.is_error_frame | FD * message.is_fd)
        asked = message.is_remote_frame and not message.is_error_frame
        lengths.append(message.dlc if asked else min(len(message.data), 64))
        payload += message.data[:8].ljust(8, b"\0")
        buses.append(message.channel + shift if isinstance(message.channel, int) else -1)
        position.append(at)
    lines = damage.lines(len(t_s)) + tail()
    if not t_s:
        raise LapError(f"{damage.where}: {lines[0] if lines else 'no CAN frame'}")
    return Frames(
        t_ns=nanoseconds(np.frombuffer(t_s, dtype=np.float64)),
        id=np.frombuffer(identifiers, dtype=np.uint32),
        extended=np.frombuffer(extended, dtype=np.bool_),
        flags=np.frombuffer(flags, dtype=np.uint8),
        length=np.frombuffer(lengths, dtype=np.uint8),
        payload=np.frombuffer(payload, dtype=np.uint8).reshape(-1, 8),
        bus=np.frombuffer(buses, dtype=np.int32),
        at=np.frombuffer(position, dtype=np.int64),
        counted=damage.counted,
        damage=lines,
    )


def _wrong(message: "can.Message") -> str:
    """Why a message of python-can, which checks little, is no CAN frame; empty if it is one."""
    if not -_FARTHEST_S < message.timestamp < _FARTHEST_S:
        return f"time {message.timestamp:g} s is beyond any lap"
    if isinstance(message.channel, int) and not -1 <= message.channel <= _LAST_BUS:
        return f"channel {message.channel}"
    if message.is_error_frame:  # whose other fields say nothing
        return ""
    highest = 0x1FFFFFFF if message.is_extended_id else 0x7FF
    if not 0 <= message.arbitration_id <= highest:
        return f"identifier {message.arbitration_id:#x} is beyond {highest:#x}"
    data, dlc = len(message.data), message.dlc
    if not 0 <= dlc <= 64 or data > 64:
        return f"length {dlc} is beyond any frame"
    if not (message.is_remote_frame or message.is_fd) and data != min(dlc, 8):
        return f"{data} data bytes where the length is {dlc}"
    return ""
