"""What the bench knows of an ECU: frames, time in nanoseconds, and nothing else.

Sans-I/O: an ECU is handed frames with their instant, is told how far it may run, and answers with the
transmissions it requests. Belongs here: the protocol and its two value types. Never: a bus, a lap, a clock.
"""

from typing import NamedTuple, Protocol


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
