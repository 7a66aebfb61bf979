"""What the bench knows of an ECU: frames, time in nanoseconds, and nothing else.

Sans-I/O: an ECU is handed frames with their instant, is told how far it may run, and answers with the
transmissions it requests. Belongs here: the protocols and their value types. Never: a bus, a lap, a clock.
"""

from enum import IntEnum
from typing import NamedTuple, Protocol, runtime_checkable


class Frame(NamedTuple):
    """A classic CAN data frame: 11-bit identifier (29-bit if `extended`) and 0 to 8 data bytes."""

    id: int
    data: bytes
    extended: bool = False


class Transmission(NamedTuple):
    """A request to send `frame`, made at `t_ns`; `handle` names it when the bus reports it sent."""

    t_ns: int
    handle: int
    frame: Frame


class Ecu(Protocol):
    """A device under test on the bus.

    The caller alternates: `advance(t)` until it returns None, then `receive`/`sent` at that same t.
    """

    name: str

    def advance(self, t_ns: int) -> Transmission | None:
        """Run until `t_ns`, or stop early at the first new transmit request and return it.

        Raises FirmwareFault if the firmware did something fatal.
        """

    def receive(self, frame: Frame, t_ns: int) -> None:
        """Hand over a frame whose end came at `t_ns` on the bus."""

    def sent(self, handle: int, t_ns: int) -> None:
        """Report that the requested transmission `handle` ended on the bus at `t_ns`."""

    def where(self) -> str:
        """Where the program stands, for the report of an ECU that no longer answers ('' if unknown)."""


class Confinement(IntEnum):
    """How far a node takes part in its bus (ISO 11898-1 clause 12.1.4): not at all, hearing, or sending."""

    OFF = 0
    SILENT = 1
    PASSIVE = 2
    ACTIVE = 3


class ErrorCode(IntEnum):
    """Kinds of error that a node sees, numbered as bxCAN's last error code."""

    STUFF = 1
    FORM = 2
    ACKNOWLEDGMENT = 3
    BIT_RECESSIVE = 4
    BIT_DOMINANT = 5
    CRC = 6


class SeenError(NamedTuple):
    """An error as one node sees it, and what it adds to that node's transmit and receive error counters."""

    code: ErrorCode
    tec: int
    rec: int


@runtime_checkable
class Controller(Protocol):
    """A CAN controller with mailboxes, modes and error counters of its own, as its bus deals with it.

    An `Ecu` that is no Controller is an ideal node: the bus keeps its queue and its error counters. Beside
    these methods the bus calls `receive` and `sent`, which end a frame as `ended` does.
    """

    def confinement(self) -> Confinement:
        """How far it takes part at present."""

    def offer(self, t_ns: int) -> Transmission | None:
        """The frame it would start at `t_ns`, None if it has none or may not."""

    def started(self, handle: int | None, t_ns: int) -> None:
        """A frame starts at `t_ns`: its own `handle`, None: another node's."""

    def lost(self, handle: int) -> None:
        """Its `handle` lost the arbitration of the frame that has just started."""

    def error(self, handle: int | None, error: SeenError, t_ns: int) -> None:
        """It sees an error at `t_ns` while it sends `handle`, None: while it receives."""

    def ended(self, t_ns: int) -> None:
        """The bus is free again at `t_ns`, and nothing was sent or received."""
