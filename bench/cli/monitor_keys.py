"""The keyboard of a live command: single keys, without waiting, and a terminal left as it was found."""

import os
import re
import select
import termios
import tty
from types import TracebackType
from typing import Any, Self

_ESCAPES = re.compile(rb"\x1b(\[[0-?]*[ -/]*[@-~]|O.|.)?", re.DOTALL)
"""What arrow and function keys send; none of it is a key of ours."""


class Keyboard:
    """The terminal behind file descriptor `fd`, in cbreak mode within the block; silent if it is none.

    A process in the background leaves the terminal alone: it belongs to another one.
    """

    def __init__(self, fd: int) -> None:
        self._fd = fd
        self._before: list[Any] | None = None

    def pressed(self) -> str:
        """The keys pressed since the last call, in order."""
        if self._before is None or not select.select([self._fd], [], [], 0)[0]:
            return ""
        try:
            data = os.read(self._fd, 256)
        except OSError:  # the terminal has gone
            data = b""
        if not data:
            self._before = None
        return _ESCAPES.sub(b"", data).decode("ascii", "ignore")

    def __enter__(self) -> Self:
        try:
            if os.isatty(self._fd) and os.tcgetpgrp(self._fd) == os.getpgrp():
                before = termios.tcgetattr(self._fd)
                self._before = before
                tty.setcbreak(self._fd, termios.TCSANOW)
        except (OSError, termios.error):
            self._before = None
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._before is not None:
            termios.tcsetattr(self._fd, termios.TCSANOW, self._before)
            self._before = None
