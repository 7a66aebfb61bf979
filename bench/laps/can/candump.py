"""CAN logs of candump: the compact format of `candump -L`, one frame a line.

    (1713559096.395291) can0 12F#F82000200000003D
    (1713559096.395291) can0 1ABCDEF0#R8 T

Belongs here: a line's bytes, read where they lie. Never: a signal. A bus is the number that ends its
interface's name (can0 is 0). Kernels instead of python-can's reader: a campaign's logs are read in
milliseconds, times keep every digit, and what is no frame is named by its line.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.errors import LapError
from bench.laps.can import log as can_log
from bench.laps.can.frames import ERROR, FD, NAMED, REMOTE, Damage, Frames, shown
from bench.laps.channel_map import ChannelMap
from bench.laps.lap import Lap
from bench.laps.recording import Recording
from targets.jit import njit

SHORTEST = 11
"""Bytes of the shortest frame's line, `(0) c 123#` and its end."""


def read(path: Path, channel_map: ChannelMap | None = None) -> Recording:
    """Read a log through the map's DBC; times as they stand in it, to the nanosecond."""
    return can_log.recording(path, parse(can_log.content(path), str(path)), channel_map)


def write(lap: Lap, path: Path) -> None:
    """Write what the logger would send during `lap`; microseconds."""
    can_log.write(lap, path, ".log")


def parse(data: bytes, where: str) -> Frames:
    """The frames of a log's bytes; an isolated line that is no frame, and an unfinished last one, is damage.

    Raises LapError naming `where` and the line if the first line is no frame, or more than one in a hundred.
    """
    room = min(data.count(b"#"), len(data) // SHORTEST) + 1
    frames = Frames(
        t_ns=np.empty(room, np.int64),
        id=np.empty(room, np.uint32),
        extended=np.empty(room, np.bool_),
        flags=np.empty(room, np.uint8),
        length=np.empty(room, np.uint8),
        payload=np.empty((room, 8), np.uint8),
        bus=np.empty(room, np.int32),
        at=np.empty(room, np.int64),
    )
    wrong = np.zeros((NAMED + 1, 4), np.int64)
    columns = (
        frames.t_ns,
        frames.id,
        frames.extended,
        frames.flags,
        frames.length,
        frames.payload,
        frames.bus,
    )
    good, bad, last, last_is_bad = _scan(np.frombuffer(data, np.uint8), *columns, frames.at, wrong)
    damage = Damage(where)
    tail: tuple[str, ...] = ()
    if not data.endswith(b"\n"):
        begin = data.rfind(b"\n") + 1
        text = shown(data[begin : begin + 100].decode("latin-1"))
        tail = (f"line {last}: {'' if last_is_bad else 'possibly '}cut short, it does not end: {text}",)
    bad -= last_is_bad
    for at, begin, end, before in wrong[: min(bad, NAMED)].tolist():
        text = shown(data[begin : min(end, begin + 100)].decode("latin-1"))
        damage.add(at, f"no frame of candump -L: {text}", before)
    damage.count = bad
    lines = damage.lines(good) + tail
    if good == 0:
        raise LapError(f"{where}: {lines[0] if lines else 'no CAN frame'}")
    return frames.rows(slice(good), lines)


@njit(cache=True, nogil=True)
def _scan(
    text: NDArray[np.uint8],
    t_ns: NDArray[np.int64],
    ids: NDArray[np.uint32],
    extended: NDArray[np.bool_],
    flags: NDArray[np.uint8],
    length: NDArray[np.uint8],
    payload: NDArray[np.uint8],
    bus: NDArray[np.int32],
    at: NDArray[np.int64],
    wrong: NDArray[np.int64],
) -> tuple[int, int, int, bool]:
    """Fill the columns; `wrong` with (line, begin, end, good lines before) of the first that are no frame.

    Returns how many lines are frames, how many are not, the last line's number, and whether it lacks both
    its end and a frame.
    """
    line, good, bad, unfinished = 0, 0, 0, False
    p = 0
    while p < len(text):
        line += 1
        begin = p
        p = _blank(text, p)
        if p == len(text) or text[p] == _END:
            p += 1
            continue
        p = _blank(text, _frame(text, p, good, t_ns, ids, extended, flags, length, payload, bus))
        # direction
        if 0 < p < len(text) and (text[p] | 32 == 114 or text[p] | 32 == 116) and text[p - 1] <= 32:
            p = _blank(text, p + 1)
        if p == len(text) or (p > 0 and text[p] == _END):
            at[good] = line
            good += 1
            p += 1
            continue
        p = begin
        while p < len(text) and text[p] != _END:
            p += 1
        if bad < len(wrong):
            wrong[bad, 0], wrong[bad, 1], wrong[bad, 2], wrong[bad, 3] = line, begin, p, good
        bad += 1
        unfinished = p == len(text)
        p += 1
    return good, bad, line, unfinished


_END = 10
_NIBBLE = np.full(256, 255, np.uint8)
_NIBBLE[[*b"0123456789abcdef"]] = _NIBBLE[[*b"0123456789ABCDEF"]] = np.arange(16)
"""Byte -> the value of the hexadecimal digit that it is; 255 if it is none."""


@njit(cache=True, nogil=True, inline="always")
def _frame(
    text: NDArray[np.uint8],
    p: int,
    row: int,
    t_ns: NDArray[np.int64],
    ids: NDArray[np.uint32],
    extended: NDArray[np.bool_],
    flags: NDArray[np.uint8],
    length: NDArray[np.uint8],
    payload: NDArray[np.uint8],
    bus: NDArray[np.int32],
) -> int:
    """Read one frame from p into row `row`; returns where it ends, -1 if it is none and the row of no use.

    A line's end stops every loop, for it is part of nothing.
    """
    stop = len(text)
    # (seconds.fraction)
    if text[p] != 40:
        return -1
    begin, seconds = p + 1, 0
    p = begin
    while p < stop and p - begin < 10 and 48 <= text[p] <= 57:
        seconds = seconds * 10 + (text[p] - 48)
        p += 1
    if p == begin or p >= stop or seconds > 9_200_000_000:
        return -1
    t = seconds * 1_000_000_000
    if text[p] == 46:
        begin, unit = p + 1, 1_000_000_000
        p = begin
        while p < stop and p - begin < 9 and 48 <= text[p] <= 57:
            unit //= 10
            t += unit * (text[p] - 48)
            p += 1
        if p == begin:
            return -1
    if p >= stop or text[p] != 41:
        return -1
    t_ns[row] = t
    begin = p + 1
    p = _blank(text, begin)
    if p == begin:
        return -1
    # interface: any name; its bus is the number at its end
    number, digits = 0, 0
    while p < stop and text[p] > 32:
        digit = text[p] - 48
        digits = digits + 1 if 0 <= digit <= 9 else 0
        number = 0 if digits == 0 else min(number * 10 + digit, 1_000_000_000)
        p += 1
    bus[row] = number if digits > 0 and number < 1_000_000_000 else -1
    begin = p
    p = _blank(text, begin)
    if p == begin:
        return -1
    # identifier#
    begin, identifier = p, 0
    while p < stop and p - begin < 8 and _NIBBLE[text[p]] < 16:
        identifier = identifier * 16 + _NIBBLE[text[p]]
        p += 1
    if not (p - begin == 3 or p - begin == 8) or p >= stop or text[p] != 35:
        return -1
    extended[row] = p - begin == 8
    flag = 0
    if identifier >> 29 == 1:  # the kernel's CAN_ERR_FLAG
        flag = ERROR
    elif identifier > (0x1FFFFFFF if extended[row] else 0x7FF):
        return -1
    ids[row] = identifier & 0x1FFFFFFF
    p += 1
    # data, or R and the length, or # flags data
    count, most = 0, 8
    for k in range(8):
        payload[row, k] = 0
    if p < stop and text[p] | 32 == 114:
        flag |= REMOTE
        p += 1
        if p < stop and 48 <= text[p] <= 56:
            count = text[p] - 48
            p += 1
    else:
        if p < stop and text[p] == 35:
            if p + 1 >= stop or _NIBBLE[text[p + 1]] > 15:
                return -1
            flag |= FD
            most = 64
            p += 2
        while p + 1 < stop and count < most and (_NIBBLE[text[p]] | _NIBBLE[text[p + 1]]) < 16:
            if count < 8:
                payload[row, count] = _NIBBLE[text[p]] * 16 + _NIBBLE[text[p + 1]]
            count += 1
            p += 2
    flags[row], length[row] = flag, count
    return p


@njit(cache=True, nogil=True, inline="always")
def _blank(text: NDArray[np.uint8], p: int) -> int:
    """Past spaces, tabs and carriage returns from p; a negative p stays."""
    while 0 <= p < len(text) and (text[p] == 32 or text[p] == 9 or text[p] == 13):
        p += 1
    return p
