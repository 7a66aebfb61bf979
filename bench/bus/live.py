"""A live bus: any python-can interface, as the rim of the bench. Here alone are sockets opened.

Belongs here: python-can messages to frames and back. Never: pacing (clocks), what a frame means.
"""

import errno
import logging
import socket
import sys
import time
from types import TracebackType
from typing import TYPE_CHECKING, Any, NamedTuple, Self

from bench.bus.hub.place import DEFAULT
from bench.bus.hub.wire import INTERFACE as OWN_INTERFACE
from bench.errors import BusError
from targets.ecu import Frame

if TYPE_CHECKING:
    from bench.bus.hub.client import HubBus

RECEIVE_BUFFER = 2 * 1024 * 1024
"""Bytes asked of the kernel for frames not read yet; its default holds 278 frames, 35 ms of a full bus."""

_SO_MEMINFO, _DROPS = 55, 8  # Linux; and the word of its answer that counts what found no room
_SO_RCVBUFFORCE = 33  # Linux; Python does not name it

_OLDEST_S = 10.0
"""An age beyond this is no age: the adapter stamps its frames from another epoch."""

_SILENCE = logging.NullHandler()

_MOST_SKIPPED = 64  # a bus full of error frames may not keep the caller from its own business


class Heard(NamedTuple):
    """A received frame, and how long ago it arrived: 0 if the interface cannot tell."""

    frame: Frame
    age_ns: int


class LiveBus:
    """The bus named IFACE[:CHANNEL], e.g. `socketcan:vcan0` or `udp_multicast:239.74.163.2`.

    echoes: whether it hears its own frames, which most interfaces keep to themselves.
    refusal: why it took no frame last, "" where the interface does not tell.
    Raises BusError, naming the interface, if it cannot be opened.
    """

    _hub: "HubBus | None" = None  # our own interface says more than others

    def __init__(self, name: str, bitrate: int = 500_000) -> None:
        # Without a handler of its own python-can would say on the error stream what is raised here anyway.
        logging.getLogger("can").addHandler(_SILENCE)
        import can

        interface, _, channel = name.partition(":")
        known = {OWN_INTERFACE, *can.VALID_INTERFACES}
        if interface not in known:
            raise BusError(f"{name}: no interface {interface!r}; python-can has {', '.join(sorted(known))}")
        self.name = name
        self._can = can
        try:
            if interface == OWN_INTERFACE:
                from bench.bus.hub.client import HubBus  # also there where its entry point is not installed

                self._bus = self._hub = HubBus(channel or DEFAULT)
            else:
                self._bus = can.Bus(interface=interface, channel=channel or None, bitrate=bitrate)
        except Exception as error:  # drivers of absent hardware raise whatever they meet
            raise BusError(f"{name}: cannot be opened: {_reason(error)}") from None
        self.refusal = ""
        self.echoes = interface == "udp_multicast"
        _enlarge_buffer(getattr(self._bus, "socket", None))

    def send(self, frame: Frame, timeout_s: float = 0.0) -> bool:
        """Put `frame` on the bus; False if it found no room in the interface's queue within `timeout_s`.

        Raises BusError if the interface refuses it for another reason.
        """
        message = self._can.Message(arbitration_id=frame.id, data=frame.data, is_extended_id=frame.extended)
        try:
            self._bus.send(message, timeout=timeout_s)
        except (self._can.CanError, OSError) as error:
            if isinstance(error, self._can.CanTimeoutError) or _is_full(error):
                self.refusal = self._hub.obstacle() if self._hub else ""
                return False
            raise BusError(f"{self.name}: cannot send {frame.id:#x}: {_reason(error)}") from None
        return True

    def receive(self, timeout_s: float) -> Heard | None:
        """The next data frame, None if none came within `timeout_s`; error, remote and FD frames pass by.

        Once one of those has come it waits no longer. Raises BusError if the bus has gone away.
        """
        for _ in range(_MOST_SKIPPED):
            try:
                message = self._bus.recv(timeout_s)
            except (self._can.CanError, OSError, ValueError) as error:
                raise BusError(f"{self.name}: cannot receive: {_reason(error)}") from None
            if message is None:
                break
            if not (message.is_error_frame or message.is_remote_frame or message.is_fd):
                frame = Frame(message.arbitration_id, bytes(message.data), message.is_extended_id)
                return Heard(frame, _age_ns(message.timestamp))
            timeout_s = 0.0
        return None

    def dropped(self) -> int | None:
        """Frames the kernel threw away because nobody read them in time; None where it does not tell."""
        endpoint = getattr(self._bus, "socket", None)
        if not isinstance(endpoint, socket.socket) or endpoint.fileno() < 0:
            return None
        try:
            words = endpoint.getsockopt(socket.SOL_SOCKET, _SO_MEMINFO, 4 * (_DROPS + 1))
        except OSError:
            return None
        return int.from_bytes(words[4 * _DROPS :], sys.byteorder)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bus.shutdown()


def _is_full(error: BaseException) -> bool:
    """Whether a frame was refused only because a queue is full: the driver's (ENOBUFS) or the socket's."""
    number = getattr(error, "error_code", None) or getattr(error, "errno", None)
    # A socket that stays full raises without a number.
    return number in (errno.ENOBUFS, errno.EAGAIN) or "buffer full" in str(error)


def _age_ns(stamp_s: float) -> int:
    age_s = time.time() - stamp_s
    return int(age_s * 1e9) if 0 <= age_s <= _OLDEST_S else 0


def _enlarge_buffer(endpoint: Any) -> None:
    """Ask for a longer receive queue, so that a pause of the process loses no frame."""
    if not isinstance(endpoint, socket.socket):
        return
    for option in (_SO_RCVBUFFORCE, socket.SO_RCVBUF):  # the first may pass the system's limit, as root
        try:
            endpoint.setsockopt(socket.SOL_SOCKET, option, RECEIVE_BUFFER)
        except OSError:
            continue
        return


def _reason(error: BaseException) -> str:
    return " ".join(str(error).split()) or type(error).__name__
