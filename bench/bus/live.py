"""A live bus: any python-can interface, as the rim of the bench. Here alone are sockets opened.

Belongs here: python-can messages to frames and back. Never: pacing (clocks), what a frame means.
"""

from types import TracebackType
from typing import Self

from bench.errors import BusError
from targets.ecu import Frame


class LiveBus:
    """The bus named IFACE[:CHANNEL], e.g. `socketcan:vcan0` or `udp_multicast:239.74.163.2`.

    Raises BusError, naming the interface, if it cannot be opened.
    """

    def __init__(self, name: str, bitrate: int = 500_000) -> None:
        import can

        interface, _, channel = name.partition(":")
        if interface not in can.VALID_INTERFACES:
            known = ", ".join(sorted(can.VALID_INTERFACES))
            raise BusError(f"{name}: no interface {interface!r}; python-can has {known}")
        self.name = name
        self._can = can
        try:
            self._bus = can.Bus(interface=interface, channel=channel or None, bitrate=bitrate)
        except (can.CanError, OSError, ValueError, TypeError, ImportError, NotImplementedError) as error:
            raise BusError(f"{name}: cannot be opened: {_reason(error)}") from None

    def send(self, frame: Frame) -> None:
        """Put `frame` on the bus; BusError if the interface refuses it."""
        message = self._can.Message(arbitration_id=frame.id, data=frame.data, is_extended_id=frame.extended)
        try:
            self._bus.send(message, timeout=1.0)
        except (self._can.CanError, OSError) as error:
            raise BusError(f"{self.name}: cannot send {frame.id:#x}: {_reason(error)}") from None

    def receive(self, timeout_s: float) -> Frame | None:
        """The next data frame, None if none came within `timeout_s`; error and remote frames pass by."""
        try:
            message = self._bus.recv(timeout_s)
        except (self._can.CanError, OSError) as error:
            raise BusError(f"{self.name}: cannot receive: {_reason(error)}") from None
        if message is None or message.is_error_frame or message.is_remote_frame or message.is_fd:
            return None
        return Frame(message.arbitration_id, bytes(message.data), message.is_extended_id)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bus.shutdown()


def _reason(error: BaseException) -> str:
    return " ".join(str(error).split()) or type(error).__name__
