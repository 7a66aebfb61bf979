"""The ground station of a live replay: its UDP socket, the .tlog, and what is said of both at the end."""

import socket
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bench.errors import MavlinkError

if TYPE_CHECKING:
    from bench.mavlink.busload import BusLoad, Row
    from bench.mavlink.link import Link
    from bench.panel import Panel
    from bench.watch import Watch

PORT = 14550
_HOST = "127.0.0.1"
_LONGEST = 2048
"""Bytes of a datagram; MAVLink's longest packet has 293."""


class GroundLink:
    """`link` on a UDP socket; `turn` reads what has come and sends what is due, without ever waiting.

    peer: HOST:PORT, PORT, or [IPV6]:PORT of the ground station. unsent: datagrams the system did not take.
    Raises MavlinkError for a peer that is none, or cannot be reached from here.
    """

    def __init__(self, peer: str, link: "Link") -> None:
        family, self.peer = _address(peer)
        self.link, self.unsent, self._last_ns = link, 0, 0
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            self._socket.connect(self.peer)  # finds the own address towards the peer, sends nothing
            host = self._socket.getsockname()[0]
            self._socket.close()
            self._socket = socket.socket(family, socket.SOCK_DGRAM)
            self._socket.setblocking(False)
            self._socket.bind((host, 0))
        except OSError as error:
            self._socket.close()
            raise MavlinkError(f"{peer}: {error.strerror or error}") from None

    @property
    def own(self) -> Any:
        """The socket's own address."""
        return self._socket.getsockname()

    def fileno(self) -> int:
        """For `select`: readable when something has come."""
        return self._socket.fileno()

    def turn(self, t_ns: int) -> None:
        """One turn at bench time `t_ns`."""
        from bench.mavlink.link import MOST_A_TURN

        self._last_ns = t_ns
        for _ in range(MOST_A_TURN):  # empty datagrams, too, come to an end
            if not self.link.hungry or not self._hear():
                break
        self._send(self.link.turn(t_ns))

    def close(self) -> None:
        """Say the last of it, as of the last turn, and close the socket; once."""
        if self._socket.fileno() < 0:
            return
        self._send(self.link.end(self._last_ns))
        self._socket.close()

    def _hear(self) -> bool:
        try:
            self.link.hear(*self._socket.recvfrom(_LONGEST))
        except BlockingIOError:
            return False
        except OSError:  # what the network says of an earlier datagram
            return True
        return True

    def _send(self, datagrams: Sequence[Any]) -> None:
        for data, to in datagrams:
            try:
                self._socket.sendto(data, to or self.peer)
            except OSError:
                self.unsent += 1


@dataclass
class Ground:
    """The options of a replay's ground station; peer None: there is none.

    Raises MavlinkError for options that mean nothing without others, RecordError for a .tlog that could not
    be written.
    """

    peer: str | None = None
    inject: bool = False
    inject_from: str | None = None
    tlog: Path | None = None
    joined: GroundLink | None = field(default=None, init=False)
    _load: "BusLoad | None" = field(default=None, init=False)

    def __post_init__(self) -> None:
        from bench.whole import check_writable

        if self.peer is None:
            for option, value in (
                ("--allow-inject", self.inject),
                ("--inject-from", self.inject_from),
                ("--tlog", self.tlog),
            ):
                if value:
                    raise MavlinkError(f"{option} needs --mavlink")
            return
        if self.inject_from and not self.inject:
            raise MavlinkError(f"--inject-from {self.inject_from} needs --allow-inject")
        _address(self.peer)
        if self.tlog:
            check_writable(self.tlog)

    def joining(
        self, watch: "Watch | None", bitrate: int, speed: float
    ) -> "Callable[[Panel], AbstractContextManager[Callable[[int], None]]] | None":
        """What gives, for the replay's fault panel, the link's turn; None without a ground station."""
        if self.peer is None:
            return None
        from bench.mavlink.busload import BusLoad
        from bench.mavlink.link import Rights
        from bench.mavlink.packets import common

        common()
        self._load = BusLoad(bitrate, speed)
        rights = Rights(self.inject, self.inject_from)
        return lambda panel: self._joined(panel, watch, rights, speed)

    def follow(self, frames: "Sequence[Row]") -> None:
        """Count the bus's load from `frames`, which grow."""
        if self._load:
            self._load.frames = frames

    @contextmanager
    def _joined(
        self, panel: "Panel", watch: "Watch | None", rights: Any, speed: float
    ) -> Iterator[Callable[[int], None]]:
        from bench.mavlink.injector import Injector
        from bench.mavlink.link import Link
        from bench.mavlink.telemetry import Telemetry
        from bench.whole import whole

        assert self.peer is not None
        assert self._load is not None
        telemetry = Telemetry(watch, panel, speed, self._load)
        injector = Injector(panel, round(1e9 * speed))
        link = Link(telemetry, injector, rights, time.time_ns() // 1000, speed, self.tlog is not None)
        self.joined = ground = GroundLink(self.peer, link)
        try:
            yield ground.turn
        finally:
            ground.close()
            if self.tlog:
                with whole(self.tlog) as part:
                    part.write_bytes(link.records)

    def document(self) -> dict[str, Any]:
        """For the result's JSON: what was refused, and every command that was carried out, in bench time."""
        if self.joined is None:
            return {}
        link = self.joined.link
        injector = link.injector
        return {
            "mavlink": {
                "packets_refused": link.refused,
                "packets_unsent": self.joined.unsent,
                "packets_not_recorded": link.left_out,
                "commands_refused": {result.name: count for result, count in injector.refused.items()},
                "commands": [
                    {
                        "t_s": one.t_ns / 1e9,
                        "from": str(one.asker.address[0]),
                        "asked": str(one.asked),
                        "faults": list(one.numbers),
                        "result": one.result.name,
                    }
                    for one in injector.taken
                ],
            }
        }

    def line(self) -> str | None:
        """The same in a line, None without a ground station."""
        if self.joined is None:
            return None
        link = self.joined.link
        refused = sum(link.injector.refused.values())
        return (
            f"mavlink: {len(link.injector.taken)} failure commands carried out, {refused} refused; "
            f"packets refused: {link.refused}"
        )


def _address(peer: str) -> tuple[int, Any]:
    """Family and address of the ground station's socket."""
    host, _, port = peer.rpartition(":")
    number = int(port) if port.isascii() and port.isdigit() and len(port) < 6 else 0
    if not 0 < number < 1 << 16:
        raise MavlinkError(
            f"{peer!r} has no port; a ground station is written [HOST:]PORT, e.g. {_HOST}:{PORT}"
        )
    try:
        found = socket.getaddrinfo(host.strip("[]") or _HOST, number, type=socket.SOCK_DGRAM)
    except (OSError, UnicodeError) as error:
        raise MavlinkError(f"{peer}: {getattr(error, 'strerror', None) or error}") from None
    return found[0][0], found[0][4]
