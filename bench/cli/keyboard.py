"""The keyboard of a live command: single keys, without waiting, and what they fire."""

import os
import re
import select
import termios
import tty
from types import TracebackType
from typing import Any, Self

from bench.control import parse_command
from bench.errors import FaultError

RESERVED = {"q": "quit", "c": "clear", " ": "pause"}
"""Keys with a meaning of their own."""

DEFAULTS = {
    "1": "rear_stroke:open",
    "2": "rear_stroke:short",
    "3": "rear_stroke:hold",
    "4": "rear_stroke:uncalibration:gain=1.1",
    "5": "fork_stroke:open",
    "6": "fork_stroke:short",
    "7": "fork_stroke:hold",
    "8": "pitch_rate:open",
    "9": "speed:hold",
}

_ESCAPES = re.compile(rb"\x1b(\[[0-?]*[ -/]*[@-~]|O.|.)?", re.DOTALL)
"""What arrow and function keys send; none of it is a key of ours."""


class Keyboard:
    """The terminal behind file descriptor `fd`, in cbreak mode within the block, then as before; or silence.

    A process in the background leaves the terminal alone: it belongs to another one.
    """

    def __init__(self, fd: int) -> None:
        self._fd = fd
        self._before: list[Any] | None = None

    @property
    def listening(self) -> bool:
        """Whether there is a terminal that is ours."""
        return self._before is not None

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


def key_faults(given: list[str]) -> dict[str, str]:
    """Key -> fault, from `KEY=SPEC` each; DEFAULTS without any. Raises FaultError."""
    found: dict[str, str] = {}
    for text in given:
        key, equals, spec = text.partition("=")
        if not equals or len(key) != 1 or not key.isascii() or not key.isprintable():
            raise FaultError(f"--key {text!r} is not written KEY=SPEC with a single character")
        if key in RESERVED:
            raise FaultError(f"--key {text!r}: {key!r} means {RESERVED[key]}")
        if key in found:
            raise FaultError(f"--key {text!r}: {key!r} fires {found[key]} already")
        parse_command(spec)
        found[key] = spec
    return found or dict(DEFAULTS)
