"""The bench's end of a MAVLink link: bytes, source address and bench time in, bytes out. Sans-I/O.

Belongs here: who is heard, who may inject, how much is read at a time, what is recorded. Never: a socket.
"""

from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from ipaddress import ip_address
from typing import Any, NamedTuple

from bench.errors import MavlinkError
from bench.mavlink.injector import INJECT, Ack, Asker, Injector, Result
from bench.mavlink.packets import COMPONENT, SYSTEM, Packer, common, record, split, unpack
from bench.mavlink.telemetry import Telemetry

MOST_A_TURN = 8
"""Packets looked at in one turn: about a millisecond's work. The others wait."""

MOST_RECORDED = 1 << 28
"""Bytes of a .tlog: days of riding; what a flood would add is left out."""

_REQUEST_MESSAGE = 512
_AUTOPILOT_VERSION = 148
_UNKNOWN = 255  # how far a command has come


class Datagram(NamedTuple):
    """To be sent; to: the address, None for the ground station."""

    data: bytes
    to: Any = None


@dataclass(frozen=True)
class Rights:
    """Who may inject failures: nobody, unless `inject`; then this machine, or instead the host `address`.

    Raises MavlinkError for an address that is none.
    """

    inject: bool = False
    address: str | None = None

    def __post_init__(self) -> None:
        if self.address is not None:
            try:
                ip_address(self.address)
            except ValueError:
                raise MavlinkError(f"{self.address!r} to inject from is no IP address") from None

    def allow(self, host: str) -> bool:
        """Whether a command from `host` may inject."""
        if not self.inject:
            return False
        source = ip_address(host)
        return source.is_loopback if self.address is None else source == ip_address(self.address)


class Link:
    """A ground station's link. epoch_us: microseconds since 1970 when bench time was 0; speed: bench time
    over the wall's.

    refused: packets that were damaged, or none. records: the .tlog so far, of both directions; left_out:
    packets it has no room for.
    """

    def __init__(
        self,
        telemetry: Telemetry,
        injector: Injector,
        rights: Rights,
        epoch_us: int = 0,
        speed: float = 1.0,
        recording: bool = True,
    ) -> None:
        self._telemetry, self.injector, self._rights = telemetry, injector, rights
        self._epoch_us, self._speed, self._recording = epoch_us, speed, recording
        self._packer = Packer()
        self._waiting: deque[tuple[bytes, Any]] = deque()
        self.records = bytearray()
        self.refused = self.left_out = 0

    @property
    def hungry(self) -> bool:
        """Whether `turn` has room for another datagram."""
        return len(self._waiting) < MOST_A_TURN

    def hear(self, datagram: bytes, source: Any) -> None:
        """What came from `source`, a socket's address with the host first."""
        packets, refused = split(datagram)
        self.refused += refused
        self._waiting.extend((packet, source) for packet in packets)

    def turn(self, t_ns: int) -> list[Datagram]:
        """What is to be sent at bench time `t_ns`, in order."""
        out = []
        for _ in range(min(MOST_A_TURN, len(self._waiting))):
            out += self._read(*self._waiting.popleft(), t_ns)
        out += self._answers(self.injector.turn(t_ns), t_ns)
        out += [self._packed(message, None, t_ns) for message in self._telemetry.due(t_ns)]
        return out

    def end(self, t_ns: int) -> list[Datagram]:
        """The last of it: the lap is over at `t_ns`."""
        texts = [self._packed(message, None, t_ns) for message in self._telemetry.due(t_ns)]
        return texts + self._answers(self.injector.end(t_ns), t_ns)

    def _read(self, packet: bytes, source: Any, t_ns: int) -> list[Datagram]:
        message = unpack(packet)
        if message is None:
            self.refused += 1
            return []
        self._record(packet, t_ns)
        fields = message.fields
        if (message.system, message.component) == (SYSTEM, COMPONENT) or not fields:
            return []
        if fields["target_system"] not in (0, SYSTEM) or fields["target_component"] not in (0, COMPONENT):
            return []
        asker = Asker(source, message.system, message.component)
        if fields["command"] == INJECT:
            ack = self.injector.command(fields, asker, self._rights.allow(source[0]), t_ns)
            return self._answers([ack], t_ns)
        return self._other(fields, asker, t_ns)

    def _other(self, fields: Mapping[str, Any], asker: Asker, t_ns: int) -> list[Datagram]:
        """Ground stations ask a new vehicle what it can do, and ask again until they are told."""
        version = fields["command"] == _REQUEST_MESSAGE and fields["param1"] == _AUTOPILOT_VERSION
        result = Result.ACCEPTED if version else Result.UNSUPPORTED
        out = self._answers([Ack(fields["command"], result, asker)], t_ns)
        if version:
            can = common().MAV_PROTOCOL_CAPABILITY_COMMAND_INT | common().MAV_PROTOCOL_CAPABILITY_MAVLINK2
            none = bytes(8)
            words = (can, 0, 0, 0, 0, none, none, none, 0, 0, 0)
            out.append(self._packed(common().MAVLink_autopilot_version_message(*words), asker.address, t_ns))
        return out

    def _answers(self, acks: Iterable[Ack], t_ns: int) -> list[Datagram]:
        out = []
        for command, result, to in acks:
            progress = _UNKNOWN if result is Result.IN_PROGRESS else 0
            message = common().MAVLink_command_ack_message(
                command, result, progress, 0, to.system, to.component
            )
            out.append(self._packed(message, to.address, t_ns))
        return out

    def _packed(self, message: Any, to: Any, t_ns: int) -> Datagram:
        packet = self._packer.pack(message)
        self._record(packet, t_ns)
        return Datagram(packet, to)

    def _record(self, packet: bytes, t_ns: int) -> None:
        if not self._recording:
            return
        if len(self.records) >= MOST_RECORDED:
            self.left_out += 1
            return
        self.records += record(self._epoch_us + round(t_ns / self._speed / 1000), packet)
