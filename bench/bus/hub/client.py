"""The python-can interface `strokebench`: a CAN bus for the processes of one user, over a hub.

Belongs here: python-can's side of it. Never: starting hubs (start), the layout of records (wire).
"""

import contextlib
import os
import select
import socket
import threading
import time
from typing import Any

import can
from can.bus import BusState, CanProtocol

from bench.bus.hub import wire
from bench.bus.hub.place import DEFAULT
from bench.bus.hub.start import connect, running
from bench.errors import BusError

_CHUNK = 1 << 16
_SELECTABLE = 1024
_SLICE_S = 0.05
"""How long a sender that waits looks away from what comes in for it."""


class HubBus(can.BusABC):
    """A node on the bus `channel`. The first one starts its hub, which ends a few seconds after the last one.

    receive_own_messages: also hear what this node sends, with `is_rx` False. fd: send and hear FD frames; a
    timed bus has none. timed: the bus must run at this bit rate, bit/s, under arbitration; None: as it is
    found, or without. `bitrate`, as other interfaces want it, changes nothing.

    Raises CanInitializationError, naming the channel, if there is no hub to be had, or only another one than
    asked for. Use by several threads is safe. Frames have the hub's time, the same for every node.
    """

    def __init__(
        self,
        channel: Any = DEFAULT,
        can_filters: Any = None,
        receive_own_messages: bool = False,
        fd: bool = True,
        timed: int | None = None,
        **kwargs: Any,
    ) -> None:
        self.channel = channel
        self.name = f"{wire.INTERFACE}:{channel}"
        try:
            timed = None if timed is None else int(timed)
            self._socket, self.timed, more = connect(str(channel), receive_own_messages, timed)
        except (BusError, OSError, ValueError) as error:
            raise can.CanInitializationError(f"{self.name}: {_bare(error, self.name)}") from None
        self.receive_own_messages = receive_own_messages
        self.channel_info = f"{self.name}, {self.timed} bit/s" if self.timed else self.name
        self._can_protocol = CanProtocol.CAN_FD if fd and not self.timed else CanProtocol.CAN_20
        self._fd = self._can_protocol is CanProtocol.CAN_FD
        self._heard = bytearray(more)
        self._at = 0  # what has been read of it
        self._gone: str | None = None  # why there is no hub any more
        self._holder = ""
        self._hearing, self._sending = threading.Lock(), threading.Lock()
        self._writable = select.poll()
        self._writable.register(self._socket, select.POLLOUT)
        self._bell: _Bell | None = None
        super().__init__(channel=channel, can_filters=can_filters, **kwargs)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Hand `msg` to the hub, waiting for room up to `timeout` s; None: for as long as it takes.

        Raises CanTimeoutError that names the node that holds the bus up, CanOperationError for a message that
        is no CAN frame, a bus that is shut down, or a hub that has gone.
        """
        record = self._pack(msg)
        if not self._sending.acquire(timeout=-1 if timeout is None else max(timeout, 0)):
            raise can.CanTimeoutError(f"{self.name}: other threads are sending, for {timeout:g} s")
        try:
            self._write(record, timeout)
        finally:
            self._sending.release()

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        deadline = None if timeout is None else time.monotonic() + timeout
        if not self._hearing.acquire(timeout=-1 if timeout is None else max(timeout, 0)):
            return None, False
        try:
            while True:
                message = self._next()
                if message is not None:
                    return message, False
                self._check()
                left = None if deadline is None else max(deadline - time.monotonic(), 0)
                if not _readable(self._socket, left):
                    return None, False
                self._fill()
        finally:
            if self._bell:
                self._bell.ring(self._at < len(self._heard))
            self._hearing.release()

    def fileno(self) -> int:
        """A descriptor that is readable while there may be something to receive."""
        if not hasattr(select, "epoll"):
            raise NotImplementedError("fileno needs Linux")
        if self._is_shutdown:
            return -1
        if self._bell is None:
            self._bell = _Bell(self._socket)
            self._listen()  # which rings it, if no other thread is about to
        return self._bell.fileno()

    @property
    def state(self) -> BusState:
        """ACTIVE as long as the hub is there, then ERROR."""
        return BusState.ERROR if self._gone else BusState.ACTIVE

    @state.setter
    def state(self, new_state: BusState) -> None:
        raise NotImplementedError("the hub decides the state")

    def shutdown(self) -> None:
        """Leave the bus. What has been sent still goes to the others."""
        if self._is_shutdown:
            return
        super().shutdown()
        with contextlib.suppress(OSError):  # the hub may have been quicker
            self._socket.shutdown(socket.SHUT_RDWR)  # wakes who waits
        with self._hearing, self._sending:
            if self._bell:
                self._bell.close()
                self._bell = None
            self._socket.close()

    @staticmethod
    def _detect_available_configs() -> list[Any]:
        """The channels whose hub is running."""
        try:
            return [{"interface": wire.INTERFACE, "channel": channel} for channel in running()]
        except BusError:
            return []

    def _pack(self, msg: can.Message) -> bytes:
        flags = (
            (wire.EXTENDED if msg.is_extended_id else 0)
            | (wire.REMOTE if msg.is_remote_frame else 0)
            | (wire.ERROR if msg.is_error_frame else 0)
        )
        if msg.is_fd:
            flags |= (
                wire.FD
                | (wire.BRS if msg.bitrate_switch else 0)
                | (wire.ESI if msg.error_state_indicator else 0)
            )
            if not self._fd:
                raise can.CanOperationError(
                    f"{self.name}: cannot send an FD frame on a bus of classic frames"
                )
        length = len(msg.data)
        wrong = wire.fault(flags, msg.dlc, msg.arbitration_id, length)
        if wrong:
            raise can.CanOperationError(f"{self.name}: {wrong}")
        return wire.pack(wire.FRAME, flags, msg.dlc, msg.arbitration_id, 0, bytes(msg.data))

    def _write(self, record: bytes, timeout: float | None) -> None:
        self._check()
        deadline = None if timeout is None else time.monotonic() + timeout
        while record:
            try:
                record = record[self._socket.send(record) :]
                deadline = None  # what has been begun must be ended
                continue
            except BlockingIOError:
                pass
            except OSError:
                self._listen()
                self._lose()
            self._check()
            if deadline is not None and time.monotonic() >= deadline:
                raise can.CanTimeoutError(f"{self.name}: not sent within {timeout:g} s: {self.obstacle()}")
            left = _SLICE_S if deadline is None else min(_SLICE_S, max(deadline - time.monotonic(), 0))
            self._writable.poll(left * 1000)
            # Who waits here may be the one whose queue is full: it reads meanwhile.
            self._listen()

    def _next(self) -> can.Message | None:
        """The next frame of what has come in."""
        heard, head = self._heard, wire.HEAD.size
        while len(heard) - self._at >= head:
            at = self._at
            length, kind, flags, dlc, identifier, t_ns = wire.HEAD.unpack_from(heard, at)
            if len(heard) - at < length:
                break
            body = heard[at + head : at + length]
            self._at = at + length
            if kind != wire.FRAME:
                self._note(kind, body)
            elif self._fd or not flags & wire.FD:
                return can.Message(
                    timestamp=t_ns / 1e9,
                    arbitration_id=identifier,
                    is_extended_id=bool(flags & wire.EXTENDED),
                    is_remote_frame=bool(flags & wire.REMOTE),
                    is_error_frame=bool(flags & wire.ERROR),
                    channel=self.channel,
                    dlc=dlc,
                    data=body,
                    is_fd=bool(flags & wire.FD),
                    is_rx=not flags & wire.OWN,
                    bitrate_switch=bool(flags & wire.BRS),
                    error_state_indicator=bool(flags & wire.ESI),
                )
        return None

    def _fill(self) -> None:
        """Read what has come in, without waiting."""
        del self._heard[: self._at]
        self._at = 0
        try:
            data = self._socket.recv(_CHUNK)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if data:
            self._heard += data
        else:
            self._lose()

    def _listen(self) -> None:
        """Read what has come in, unless another thread is at it."""
        if self._hearing.acquire(blocking=False):
            try:
                if not self._is_shutdown:
                    self._fill()
                    if self._bell:
                        self._bell.ring(self._at < len(self._heard))
            finally:
                self._hearing.release()

    def _note(self, kind: int, words: bytes | bytearray) -> None:
        if kind == wire.REFUSED:
            self._gone = words.decode(errors="replace")
        elif kind == wire.HELD_UP:
            self._holder = words.decode(errors="replace")

    def obstacle(self) -> str:
        """Why the hub takes nothing, from its notices, read and unread."""
        for _, record in wire.whole(bytes(self._heard), self._at):
            if record.kind != wire.FRAME:
                self._note(record.kind, record.body)
        if self._holder:
            return f"{self._holder} does not read"
        return f"the bus is full at {self.timed} bit/s" if self.timed else "the hub does not take it"

    def _lose(self) -> None:
        """There is no hub any more, and what it said last is the reason."""
        self.obstacle()
        self._gone = self._gone or "its hub has ended"
        if self._bell:
            self._bell.forget(self._socket)

    def _check(self) -> None:
        if self._is_shutdown:
            raise can.CanOperationError(f"{self.name}: is shut down")
        if self._gone:
            raise can.CanOperationError(f"{self.name}: {self._gone}")


class _Bell:
    """A descriptor that is readable while the socket is, or while frames from it wait to be fetched."""

    def __init__(self, end: socket.socket) -> None:
        self._event = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._both = select.epoll()
        self._both.register(end, select.EPOLLIN)
        self._both.register(self._event, select.EPOLLIN)
        self._rung = False
        self._minded = True

    def fileno(self) -> int:
        return self._both.fileno()

    def ring(self, on: bool) -> None:
        """Say whether frames wait."""
        if on and not self._rung:
            os.eventfd_write(self._event, 1)
        elif self._rung and not on:
            os.eventfd_read(self._event)
        self._rung = on

    def forget(self, end: socket.socket) -> None:
        """The socket's end has been seen, and is no news."""
        if self._minded:
            self._both.unregister(end)
            self._minded = False

    def close(self) -> None:
        """Close what is the bell's own."""
        self._both.close()
        os.close(self._event)


def _readable(end: socket.socket, seconds: float | None) -> bool:
    """Whether there is something to read within `seconds`, None: for ever.

    select() keeps to the microsecond, where poll() is up to a millisecond late, but watches 1,024 files only.
    """
    if end.fileno() < _SELECTABLE:
        return bool(select.select([end], [], [], seconds)[0])
    poll = select.poll()
    poll.register(end, select.POLLIN)
    return bool(poll.poll(None if seconds is None else seconds * 1000))


def _bare(error: Exception, name: str) -> str:
    return str(error).removeprefix(f"{name}: ")
