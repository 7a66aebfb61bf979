"""Where hubs live: a directory of the user's own, in it a socket and a lock for each channel.

Belongs here: names, paths, and whether they can be trusted. Never: what goes through the socket.

The lock is held by the hub for as long as it lives, and only its holder touches the socket's name: of two
hubs that start at once one goes on, and the socket that a killed one left is replaced. A lock file is never
removed: who had it open would hold a lock that nobody else sees.
"""

import fcntl
import os
import re
from pathlib import Path
from typing import NamedTuple, Self

from bench.errors import BusError
from bench.private import own_directory

DEFAULT = "bus0"
_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.+-]{0,63}")
_PATH_BYTES = 107
"""Of a unix socket's name, on Linux."""


class Place(NamedTuple):
    """The files of one channel."""

    socket: Path
    lock: Path

    @classmethod
    def of(cls, channel: str) -> Self:
        """The place of `channel`; BusError for a name that is none, or a directory not ours alone."""
        if not _NAME.fullmatch(channel):
            raise BusError(
                f"channel {channel!r}: a name has 1 to 64 letters, digits and _ . + -, the first no sign"
            )
        folder = own_directory()
        path = folder / f"{channel}.sock"
        if len(os.fsencode(path)) > _PATH_BYTES:
            raise BusError(f"{path}: longer than the {_PATH_BYTES} bytes of a socket's name")
        return cls(path, folder / f"{channel}.lock")


def channels() -> list[str]:
    """Names of all channels that have a socket, be their hubs alive or not."""
    return sorted(path.stem for path in own_directory().glob("*.sock") if _NAME.fullmatch(path.stem))


class Lock:
    """The right to be the hub of a channel: held from `take` until `release` or the process's end."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file = -1

    def take(self) -> bool:
        """Whether the lock is ours now; False: another process has it."""
        self._file = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            self.release()
            return False
        os.ftruncate(self._file, 0)
        os.pwrite(self._file, f"{os.getpid()}\n".encode(), 0)
        return True

    def holder(self) -> str:
        """The process id in the file: of who has the lock, or had it last."""
        return self._path.read_text().strip()

    def release(self) -> None:
        """Give it back."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1
