"""The CAN frames of an MDF4 file: ASAM's bus logging, groups with the channel `CAN_DataFrame`.

Belongs here: the fields of such a group. Never: a file, blocks, a signal. A bus is the BusChannel as it is.

As arrays from asammdf, not through python-can's reader, which takes the same groups sample by sample.
FIDELITY: frames of a group that keeps its data bytes at variable length (VLSD) are refused, not read.
"""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bench.errors import LapError
from bench.laps.can.frames import FD, Frames, nanoseconds

if TYPE_CHECKING:
    from asammdf import MDF

EVENT = "CAN_DataFrame"
_FIXED_LENGTH = (0, 5)
"""Kinds of channel that lie in the record: of one length, or of up to one (MLSD)."""


def frames(mdf: "MDF", where: str, damage: tuple[str, ...]) -> Frames | None:
    """The data frames of all groups, in order of time; None if the file logs no CAN bus."""
    groups = [
        at
        for at, group in enumerate(mdf.groups)
        if group.channel_group.cycles_nr and any(channel.name == EVENT for channel in group.channels)
    ]
    if not groups:
        return None
    parts = [_group(mdf, at, where) for at in groups]
    joined = Frames(
        t_ns=np.concatenate([part.t_ns for part in parts]),
        id=np.concatenate([part.id for part in parts]),
        extended=np.concatenate([part.extended for part in parts]),
        flags=np.concatenate([part.flags for part in parts]),
        length=np.concatenate([part.length for part in parts]),
        payload=np.concatenate([part.payload for part in parts]),
        bus=np.concatenate([part.bus for part in parts]),
        at=np.concatenate([part.at for part in parts]),
        counted="frame",
    )
    # one group is in the order of the file, whatever its times
    order = np.argsort(joined.t_ns, kind="stable") if len(parts) > 1 else slice(None)
    return joined.rows(order, damage)


def _group(mdf: "MDF", at: int, where: str) -> Frames:
    """The frames of one group, counted from 1."""
    group = mdf.groups[at]
    fields = {
        channel.name.removeprefix(f"{EVENT}."): number
        for number, channel in enumerate(group.channels)
        if channel.name.startswith(f"{EVENT}.")
    }
    for name in ("ID", "DataBytes"):
        if name not in fields:
            raise LapError(f"{where}: group {at} has {EVENT} without {name}")
    if group.channels[fields["DataBytes"]].channel_type not in _FIXED_LENGTH:
        raise LapError(f"{where}: group {at} keeps data bytes of variable length; save it as .blf or .asc")

    def column(name: str, other: int | NDArray) -> NDArray:
        """A whole-numbered field; `other` where the group lacks it."""
        if name not in fields:
            return np.broadcast_to(np.asarray(other, dtype=np.int64), (cycles,))
        values = mdf.get(group=at, index=fields[name], raw=True).samples
        if values.dtype.kind not in "iub" or values.shape != (cycles,):
            raise LapError(f"{where}: group {at}: {EVENT}.{name} holds {values.shape} {values.dtype}")
        return values.astype(np.int64)

    signal = mdf.get(group=at, index=fields["DataBytes"], raw=True)
    cycles = group.channel_group.cycles_nr
    data = signal.samples
    if data.dtype != np.uint8 or data.ndim != 2 or len(data) != cycles or len(signal.timestamps) != cycles:
        raise LapError(f"{where}: group {at}: {data.shape} {data.dtype} data bytes of {cycles} frames")
    t_s = np.asarray(signal.timestamps, dtype=np.float64)
    far = np.flatnonzero(~(np.abs(t_s) < 9.2e9))
    if far.size:
        raise LapError(f"{where}: group {at}, frame {far[0] + 1}: time {t_s[far[0]]} s is beyond any lap")
    identifier = column("ID", 0)
    extended = column("IDE", identifier >> 31) != 0
    identifier = identifier & 0x1FFFFFFF
    bad = np.flatnonzero(~extended & (identifier > 0x7FF))
    length = column("DataLength", column("DLC", data.shape[1]))
    wrong = np.flatnonzero((length < 0) | (length > data.shape[1]))
    for rows, what in ((bad, "identifier"), (wrong, "length")):
        if rows.size:
            value = (identifier if what == "identifier" else length)[rows[0]]
            raise LapError(f"{where}: group {at}, frame {rows[0] + 1}: {what} {value:#x}")
    payload = np.zeros((cycles, 8), dtype=np.uint8)
    payload[:, : data.shape[1]] = data[:, :8]
    payload[np.arange(8) >= length[:, np.newaxis]] = 0
    flags = np.where(column("EDL", 0) != 0, FD, 0)
    bus = column("BusChannel", -1)
    return Frames(
        t_ns=nanoseconds(t_s),
        id=identifier.astype(np.uint32),
        extended=extended,
        flags=flags.astype(np.uint8),
        length=length.astype(np.uint8),
        payload=payload,
        bus=np.clip(bus, -1, 0xFFFF).astype(np.int32),
        at=np.arange(1, cycles + 1),
    )
