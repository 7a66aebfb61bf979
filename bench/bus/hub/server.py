"""The hub's sockets and its loop; `python -m bench.bus.hub.server CHANNEL ...` is a hub of its own.

Belongs here: connections, their beginning and their end, waiting. Never: who hears what (exchange).
"""

import contextlib
import gc
import os
import selectors
import signal
import socket
import struct
import sys
import time
from typing import NoReturn

from bench.bus.hub import wire
from bench.bus.hub.exchange import Exchange, Member
from bench.bus.hub.place import Lock, Place
from bench.errors import BusError

PATIENCE_S = 10.0
"""How long a client may hold the others up without reading anything."""
IDLE_S = 3.0
"""How long a hub that a client has started outlives its last client."""
GREETING_S = 5.0
"""How long a connection may take to say what it wants."""
CLIENTS = 250

_CHUNK, _TIMED_CHUNK = 1 << 16, 1 << 11
"""Bytes read at once; of a timed bus's clients few, so that frames wait where their senders feel it."""
_STEP_NS = 100_000_000
"""A time of day that is off by more has been set anew."""
_READ, _WRITE = selectors.EVENT_READ, selectors.EVENT_WRITE


READY, TAKEN = "ready", "taken"
"""What a hub in the background says to who has started it: it is there, or another one is."""


class HubRunning(BusError):
    """The channel has a hub."""


class _Client:
    """A connection; it is nobody's member before it has greeted."""

    def __init__(self, end: socket.socket, number: int, now_ns: int) -> None:
        self.end = end
        self.name = f"client {number}{_process(end)}"
        self.since_ns = now_ns
        self.greeting = bytearray()
        self.member: Member | None = None
        self.events = _READ
        self.ended = False  # it sends no more

    @property
    def out(self) -> bytearray:
        """What waits for it."""
        return self.member.out if self.member else bytearray()


class Hub:
    """The hub of `channel`, there from entering the context until leaving it; `serve` lets it work.

    timed: bit rate of the bus, bit/s; None: as fast as its clients. idle_s: it ends so long after its last
    client; None: never. Raises BusError if the channel has a hub already, or cannot have one.
    """

    def __init__(
        self,
        channel: str,
        timed: int | None = None,
        idle_s: float | None = None,
        patience_s: float = PATIENCE_S,
    ) -> None:
        self.channel = channel
        self.timed = timed
        self._place = Place.of(channel)
        self._lock = Lock(self._place.lock)
        self._idle_ns = None if idle_s is None else int(idle_s * 1e9)
        paced = None
        if timed is not None:
            from bench.bus.hub.paced import Paced  # compiled code, whose import takes a second

            paced = Paced(timed)
        self._exchange = Exchange(time.time_ns, int(patience_s * 1e9), paced, self._epoch)
        # a frame at 500 kbit/s lasts 0.2 ms: only select() waits for less than a millisecond
        self._selector = selectors.SelectSelector() if paced else selectors.DefaultSelector()
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._clients: dict[socket.socket, _Client] = {}
        self._number = 0
        self._begun_ns = time.monotonic_ns()
        self._epoch_ns = min(time.time_ns() - self._now() for _ in range(10))
        self._alone_ns: int | None = 0

    def __enter__(self) -> "Hub":
        if not self._lock.take():
            raise HubRunning(
                f"strokebench:{self.channel}: a hub is running already, process {self._lock.holder()}"
            )
        try:
            self._place.socket.unlink(missing_ok=True)  # left by one that was killed
            self._listener.bind(str(self._place.socket))
            self._listener.listen(CLIENTS)
        except OSError as error:
            self._lock.release()
            raise BusError(f"strokebench:{self.channel}: {self._place.socket}: {error.strerror}") from None
        self._listener.setblocking(False)
        self._selector.register(self._listener, _READ)
        return self

    def __exit__(self, *_: object) -> None:
        self._place.socket.unlink(missing_ok=True)
        for client in tuple(self._clients.values()):
            self._close(client)
        self._selector.close()
        self._listener.close()
        self._lock.release()

    def serve(self) -> None:
        """Work until the last client has left for good, or for ever."""
        while not self._abandoned(self._now()):
            self.turn()

    def turn(self, longest_s: float | None = None) -> None:
        """Wait for something to do, at most `longest_s`, and do it."""
        ready = self._selector.select(self._wait_s(longest_s))
        now_ns = self._now()
        for key, events in ready:
            if key.fileobj is self._listener:
                self._accept(now_ns)
                continue
            client = self._clients.get(key.fileobj)  # type: ignore[call-overload]  # a socket, as registered
            if client is not None and events & _READ:
                self._read(client, now_ns)
        self._exchange.run(now_ns)
        told = -1
        while told != self._exchange.told:  # who was settled first may have heard of the last one's relief
            told = self._exchange.told
            for client in tuple(self._clients.values()):
                self._settle(client, now_ns)
        greeted = any(client.member for client in self._clients.values())
        if greeted:
            self._alone_ns = None
        elif self._alone_ns is None:
            self._alone_ns = now_ns

    def _now(self) -> int:
        return time.monotonic_ns() - self._begun_ns

    def _epoch(self) -> int:
        """The time of day at instant 0; it stays, lest frames on a timed bus jitter, until it is set anew."""
        seen_ns = time.time_ns() - self._now()
        if abs(seen_ns - self._epoch_ns) > _STEP_NS:
            self._epoch_ns = seen_ns
        return self._epoch_ns

    def _abandoned(self, now_ns: int) -> bool:
        return (
            self._idle_ns is not None
            and self._alone_ns is not None
            and now_ns - self._alone_ns >= self._idle_ns
            and self._exchange.due_ns() is None
        )

    def _wait_s(self, longest_s: float | None) -> float | None:
        dues = [] if longest_s is None else [self._now() + int(longest_s * 1e9)]
        due_ns = self._exchange.due_ns()
        if due_ns is not None:
            dues.append(due_ns)
        if self._idle_ns is not None and self._alone_ns is not None:
            dues.append(self._alone_ns + self._idle_ns)
        dues += (c.since_ns + int(GREETING_S * 1e9) for c in self._clients.values() if not c.member)
        return max(min(dues) - self._now(), 0) / 1e9 if dues else None

    def _accept(self, now_ns: int) -> None:
        try:
            end, _ = self._listener.accept()
        except OSError:  # it has gone again, or this process may open no more files
            return
        if len(self._clients) >= CLIENTS:
            with contextlib.suppress(OSError):
                end.send(wire.notice(wire.REFUSED, f"the hub has {CLIENTS} clients, and takes no more"))
            end.close()
            return
        end.setblocking(False)
        self._number += 1
        self._clients[end] = _Client(end, self._number, now_ns)
        self._selector.register(end, _READ)

    def _read(self, client: _Client, now_ns: int) -> None:
        try:
            data = client.end.recv(_TIMED_CHUNK if self.timed else _CHUNK)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            client.ended = True  # all it has sent has been read by now
            return
        try:
            if client.member:
                self._exchange.take(client.member, data, now_ns)
            else:
                self._greet(client, data, now_ns)
        except wire.WireError as error:
            self._refuse(client, str(error))

    def _greet(self, client: _Client, data: bytes, now_ns: int) -> None:
        client.greeting += data
        for end, hello in wire.whole(client.greeting):
            rate = self.timed or 0
            if hello.kind != wire.HELLO:
                raise wire.WireError("the first record is no HELLO")
            if hello.dlc != wire.VERSION:
                raise wire.WireError(f"the hub speaks version {wire.VERSION}, the client {hello.dlc}")
            if hello.id and hello.id != rate:
                runs = f"at {rate} bit/s" if rate else "untimed"
                raise wire.WireError(f"the hub runs {runs}, the client asks for {hello.id} bit/s")
            client.member = self._exchange.join(client.name, bool(hello.flags & wire.OWN))
            client.member.out += wire.pack(wire.WELCOME, 0, wire.VERSION, rate, os.getpid())
            more = bytes(client.greeting[end:])
            client.greeting.clear()
            if more:
                self._exchange.take(client.member, more, now_ns)
            return

    def _refuse(self, client: _Client, why: str) -> None:
        """The last word to a client that has broken the rules."""
        with contextlib.suppress(OSError):
            if not client.out:  # else it would come amid a record
                client.end.send(wire.notice(wire.REFUSED, why))
        self._close(client)

    def _settle(self, client: _Client, now_ns: int) -> None:
        """Send what waits for `client`, and see what to expect of it next."""
        if client.member is None:
            if client.ended or now_ns - client.since_ns >= int(GREETING_S * 1e9):
                self._close(client)
            return
        if client.ended or not self._write(client.end, client.member, now_ns):
            self._close(client)
            return
        events = _WRITE if client.member.out else 0
        if self._exchange.takes_from(client.member):
            events |= _READ
        if events != client.events:
            self._listen_for(client, events)

    def _write(self, end: socket.socket, member: Member, now_ns: int) -> bool:
        """Write what goes; False: there is nobody any more, or nothing left for one that is off the bus."""
        try:
            while member.out:
                self._exchange.went(member, end.send(member.out), now_ns)
        except BlockingIOError:
            return True
        except OSError:
            self._exchange.deafen(member)  # what it sent before it went is still to be read
        return not member.expelled

    def _listen_for(self, client: _Client, events: int) -> None:
        if not events:
            self._selector.unregister(client.end)
        elif not client.events:
            self._selector.register(client.end, events)
        else:
            self._selector.modify(client.end, events)
        client.events = events

    def _close(self, client: _Client) -> None:
        del self._clients[client.end]
        if client.events:
            self._selector.unregister(client.end)
        if client.member:
            self._exchange.leave(client.member)
        client.end.close()


def _process(end: socket.socket) -> str:
    """Which process the other end belongs to, where the system tells."""
    if not hasattr(socket, "SO_PEERCRED"):
        return ""
    pid, _, _ = struct.unpack("3i", end.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, 12))
    return f" (process {pid})"


def main(words: list[str]) -> None:
    """A hub in the background: CHANNEL BITRATE, 0 for untimed; says READY on its output once it is there."""

    def end(*_: object) -> NoReturn:
        raise SystemExit(0)

    if os.fork():
        os._exit(0)  # so that who has started it need not wait for its end
    signal.signal(signal.SIGTERM, end)
    try:
        with Hub(words[0], int(words[1]) or None, IDLE_S) as hub:
            _say(READY)
            gc.freeze()
            hub.serve()
    except HubRunning:
        _say(TAKEN)
    except BusError as error:
        _say(str(error))


def _say(word: str) -> None:
    """A word to who has started it, who listens no longer after that."""
    with contextlib.suppress(BrokenPipeError):
        os.write(1, f"{word}\n".encode())
    nowhere = os.open(os.devnull, os.O_RDWR)
    os.dup2(nowhere, 1)
    os.close(nowhere)


if __name__ == "__main__":
    main(sys.argv[1:])
