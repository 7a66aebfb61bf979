"""A disturbed frame on the wire, bit by bit: who sees which error when, flags, delimiters (ISO 11898-1).

Belongs here: one frame, from its start to the end of the error frame that follows. Never: time, queues, error
counters. Undisturbed frames do not come here: their course is known beforehand.

FIDELITY: every node sees the same levels, so that a node never errs alone, and rule b) of clause 12.1.4.2 (a
dominant bit after the error flag) has no case; overload frames only where a dominant last bit of a frame asks
for one.
"""

from collections.abc import Sequence
from enum import Enum, auto
from typing import Any, NamedTuple

from numpy.typing import NDArray

from targets.ecu import Confinement, ErrorCode, Frame, SeenError
from targets.frame_bits import crc_holds, stream

DOMINANT, RECESSIVE = 0, 1
FLAG_BITS, DELIMITER_BITS = 6, 8
TEC_STEP, REC_STEP = 8, 1
_STUFF_RUN = 5
_CRC_BITS = 15
# positions behind the stuffed part of a frame
_CRC_DELIMITER, _ACK_SLOT, _ACK_DELIMITER, _LAST_BIT = 0, 1, 2, 9


class Seen(NamedTuple):
    """What a station, by its number, saw in bit `bit`: an error, or (None) that it lost the arbitration."""

    bit: int
    station: int
    error: SeenError | None


class Outcome(NamedTuple):
    """How a frame went: what was seen, in order, stations that hold it for valid, bits until all is over."""

    seen: list[Seen]
    valid: frozenset[int]
    bits: int


class _Phase(Enum):
    FRAME = auto()
    FLAG = auto()
    WAITING = auto()  # for the first recessive bit after the flag
    DELIMITER = auto()
    DONE = auto()


class _Station:
    """One node's protocol machine; `sends`: the frame's bits for the transmitter, None for a receiver.

    arbitration: number, counted without stuff bits, of the last bit of its arbitration field.
    """

    def __init__(
        self, confinement: Confinement, sends: NDArray[Any] | None = None, arbitration: int = 0
    ) -> None:
        self.confinement = confinement
        self.sends = sends
        self.arbitration = arbitration
        self.phase = _Phase.FRAME
        self.valid = False
        self._bits: list[int] = []  # unstuffed, start of frame to CRC
        self._run, self._last = 0, RECESSIVE
        self._tail = -1  # position behind the stuffed part, -1 within it
        self._crc_good = False
        self._flag = RECESSIVE  # the level of its flag
        self._count = 0  # of flag or delimiter bits
        self._level = RECESSIVE  # of the passive flag's equal bits
        self._forgiven = False  # a missing acknowledgment that does not count, so far

    @property
    def busy(self) -> bool:
        """Whether it still follows a frame or an error frame; without a start of frame it has none."""
        waits = self.phase is _Phase.FRAME and self.sends is None and not self._bits
        return self.phase is not _Phase.DONE and not waits

    def drives(self, bit: int) -> int:
        """The level it sends in bit `bit`."""
        if self.phase is _Phase.FRAME:
            if self.sends is not None:
                return int(self.sends[bit])
            acknowledges = self._tail == _ACK_SLOT and self._crc_good
            return DOMINANT if acknowledges and self.confinement > Confinement.SILENT else RECESSIVE
        return self._flag if self.phase is _Phase.FLAG else RECESSIVE

    def hears(self, level: int, sent: int) -> SeenError | bool | None:
        """Take in one bit: an error, True for a lost arbitration, or None."""
        if self.phase is _Phase.FRAME:
            return self._in_frame(level, sent)
        if self.phase is _Phase.FLAG:
            return self._in_flag(level)
        if level == RECESSIVE:
            self.phase = _Phase.DELIMITER
            self._count += 1
            if self._count == DELIMITER_BITS:
                self.phase = _Phase.DONE
        return None

    def _in_frame(self, level: int, sent: int) -> SeenError | bool | None:
        stuff_bit = self._tail < 0 and self._run == _STUFF_RUN
        tail = self._tail
        if self.sends is not None and level != sent:
            if sent == RECESSIVE and 1 <= len(self._bits) <= self.arbitration:
                if stuff_bit:  # clause 12.1.4.2 rule c), exception 2
                    return self._err(ErrorCode.STUFF, 0, 0)
                self.sends = None
                self._decode(level)
                return True
            if tail != _ACK_SLOT:
                kind = ErrorCode.BIT_RECESSIVE if sent == RECESSIVE else ErrorCode.BIT_DOMINANT
                return self._err(kind, TEC_STEP, 0)
        elif self.sends is not None and tail == _ACK_SLOT:
            passive = self.confinement is Confinement.PASSIVE
            self._forgiven = passive  # rule c), exception 1
            return self._err(ErrorCode.ACKNOWLEDGMENT, 0 if passive else TEC_STEP, 0)
        elif level != sent and sent == DOMINANT:  # its own acknowledgment
            return self._err(ErrorCode.BIT_DOMINANT, 0, REC_STEP)
        code = self._decode(level)
        if code is None:
            return None
        return self._err(code, *((TEC_STEP, 0) if self.sends is not None else (0, REC_STEP)))

    def _err(self, code: ErrorCode, tec: int, rec: int) -> SeenError:
        self._begin_flag(self.confinement is Confinement.ACTIVE)
        return SeenError(code, tec, rec)

    def _begin_flag(self, dominant: bool) -> None:
        self.phase, self._count = _Phase.FLAG, 0
        self._flag = DOMINANT if dominant else RECESSIVE

    def _in_flag(self, level: int) -> SeenError | None:
        # A passive flag is complete with six equal bits, whoever sends them.
        interrupted = self.confinement is Confinement.PASSIVE and level != self._level
        self._count = 1 if interrupted else self._count + 1
        self._level = level
        if self._count == FLAG_BITS:
            self.phase, self._count = _Phase.WAITING, 0
        if self._forgiven and level == DOMINANT:
            self._forgiven = False
            return SeenError(ErrorCode.ACKNOWLEDGMENT, TEC_STEP, 0)
        return None

    def _decode(self, level: int) -> ErrorCode | None:
        """Follow the frame by one bit as every node does."""
        if self._tail >= 0:
            return self._decode_tail(level)
        if not self._bits and level == RECESSIVE:
            return None  # no start of frame yet
        stuff_bit = self._run == _STUFF_RUN
        if stuff_bit and level == self._last:
            return ErrorCode.STUFF
        self._run = self._run + 1 if level == self._last and self._bits else 1
        self._last = level
        if not stuff_bit:
            self._bits.append(level)
        if self._run < _STUFF_RUN and len(self._bits) == self._length():
            self._tail = _CRC_DELIMITER
            self._crc_good = crc_holds(self._bits)
        return None

    def _length(self) -> int:
        """Unstuffed bits up to the end of the CRC, as the header says; 0 while it does not."""
        bits = self._bits
        header = 39 if len(bits) > 13 and bits[13] else 19
        if len(bits) < header:
            return 0
        remote = bits[32] if header == 39 else bits[12]
        size = int("".join(map(str, bits[header - 4 : header])), 2)
        return header + (0 if remote else 8 * min(size, 8)) + _CRC_BITS

    def _decode_tail(self, level: int) -> ErrorCode | None:
        tail = self._tail
        self._tail += 1
        if tail == _LAST_BIT:
            self.valid = True
            self.phase = _Phase.DONE
            if level == DOMINANT:  # to a receiver an overload condition: a flag, but no error
                self._begin_flag(self.confinement > Confinement.SILENT)
        elif level == DOMINANT and tail != _ACK_SLOT:
            return ErrorCode.FORM
        elif tail == _ACK_DELIMITER and not self._crc_good:
            return ErrorCode.CRC
        return None


def carry(
    frame: Frame, sender: Confinement, receivers: Sequence[Confinement], inverted: int | None = None
) -> Outcome:
    """Send `frame`, of which bit `inverted` comes out as the other level, as all nodes see it.

    Stations: 0 the sender, then the receivers, none of them OFF. Unacknowledged, too, the frame fails.
    """
    bits = stream(frame.id, frame.data, frame.extended)
    stations = [_Station(sender, bits, 32 if frame.extended else 12), *map(_Station, receivers)]
    seen: list[Seen] = []
    bit = 0
    while any(station.busy for station in stations):
        sent = [station.drives(bit) for station in stations]
        level = min(sent) ^ (bit == inverted)
        for number, station in enumerate(stations):
            found = station.hears(level, sent[number])
            if found is not None:
                seen.append(Seen(bit, number, found if isinstance(found, SeenError) else None))
        bit += 1
    valid = frozenset(number for number, station in enumerate(stations) if station.valid)
    return Outcome(seen, valid, bit)
