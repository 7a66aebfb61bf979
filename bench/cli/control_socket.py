"""The socket by which a running replay takes commands: unix, in the user's own folder, one line a command."""

import re
import socket
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Self

from bench.errors import BenchError
from bench.private import own_directory

_SUFFIX = ".replay"
_MOST_CLIENTS = 16


def address(bus: str) -> Path:
    """Where a replay on `bus` listens."""
    return own_directory() / (re.sub(r"[^\w.-]", "_", bus) + _SUFFIX)


def running() -> list[Path]:
    """The addresses at which replays listen."""
    return [path for path in sorted(own_directory().glob(f"*{_SUFFIX}")) if _alive(path)]


def ask(path: Path, line: bytes, timeout_s: float = 5.0) -> bytes:
    """The answer of the replay at `path` to `line`; BenchError if there is none."""
    try:
        with socket.socket(socket.AF_UNIX) as connection:
            connection.settimeout(timeout_s)
            connection.connect(str(path))
            connection.sendall(line + b"\n")
            with connection.makefile("rb") as stream:
                reply = stream.readline()
    except OSError as error:
        raise BenchError(f"no replay answers at {path}: {error.strerror or error}") from None
    if not reply.endswith(b"\n"):
        raise BenchError(f"the replay at {path} ended before it answered")
    return reply


class ControlSocket:
    """Listens at `path`; `turn` reads what has come and answers with `reply`, without ever waiting.

    Raises BenchError if another replay listens there.
    """

    def __init__(self, path: Path, reply: Callable[[bytes, int], bytes], longest: int) -> None:
        self._path, self._reply, self._longest = path, reply, longest
        self._clients: dict[socket.socket, bytearray] = {}
        if path.exists():
            if _alive(path):
                raise BenchError(f"another replay of this user is on that bus: {path}")
            path.unlink(missing_ok=True)
        self._server = socket.socket(socket.AF_UNIX)
        try:
            self._server.bind(str(path))
        except OSError as error:
            self._server.close()
            raise BenchError(f"{path}: {error.strerror or error}") from None
        self._server.listen()
        self._server.setblocking(False)

    def turn(self, t_ns: int) -> None:
        """Serve those who have asked for something; `t_ns`: bench time."""
        if len(self._clients) < _MOST_CLIENTS:
            with suppress(BlockingIOError):
                connection, _ = self._server.accept()
                connection.setblocking(False)
                self._clients[connection] = bytearray()
        for connection, pending in list(self._clients.items()):
            self._serve(connection, pending, t_ns)

    def _serve(self, connection: socket.socket, pending: bytearray, t_ns: int) -> None:
        try:
            data = connection.recv(self._longest)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        pending += data
        while b"\n" in pending:
            line, _, rest = bytes(pending).partition(b"\n")
            pending[:] = rest
            try:
                connection.sendall(self._reply(line, t_ns) + b"\n")
            except OSError:  # gone, or asking without reading what it is told
                data = b""
        if not data or len(pending) >= self._longest:
            connection.close()
            del self._clients[connection]

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for connection in (*self._clients, self._server):
            connection.close()
        self._path.unlink(missing_ok=True)


def _alive(path: Path) -> bool:
    with socket.socket(socket.AF_UNIX) as probe:
        probe.settimeout(1.0)
        try:
            probe.connect(str(path))
        except OSError:
            return False
    return True
