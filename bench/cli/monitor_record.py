"""What a monitor hears, as a recording.

A candump log is written frame by frame, a whole line at a time, so that what was heard is on disk even if the
process is killed; the other formats are written by `bench.recorder` when the monitor ends.
"""

import errno
import io
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from bench.errors import RecordError
from bench.recorder import CHANNELS, Row, check_target, record
from targets.ecu import Frame

HEARD = "heard"
"""The node of a frame whose sender a listener does not know."""

Write = Callable[[int, Frame], None]


@contextmanager
def recording(path: Path | None) -> Iterator[Write]:
    """Yields what to call with every frame and its instant; however the block ends, the file is complete.

    An existing file is replaced, a .log at once, the others at the end. Raises RecordError as the recorder.
    """
    if path is None:
        yield lambda t_ns, frame: None
        return
    check_target(path)
    if path.suffix.lower() == ".log":
        with _log(path) as write:
            yield write
        return
    rows: list[Row] = []
    try:
        yield lambda t_ns, frame: rows.append((t_ns, frame, HEARD))
    finally:
        record(path, rows)


@contextmanager
def _log(path: Path) -> Iterator[Write]:
    import can

    with _opened(path) as file:
        writer = can.CanutilsLogWriter(file)

        def write(t_ns: int, frame: Frame) -> None:
            writer.on_message_received(
                can.Message(
                    timestamp=t_ns / 1e9,
                    arbitration_id=frame.id,
                    is_extended_id=frame.extended,
                    data=frame.data,
                    channel=CHANNELS["bus"],
                )
            )

        yield write


@contextmanager
def _opened(path: Path) -> "Iterator[_Lines]":
    """`path`, empty; it takes the place of an older file in one step."""
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    special = path.exists() and not path.is_file()  # a device or a pipe is written to as it is
    try:
        fd = os.open(path if special else part, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o666)
        try:
            if not special:
                part.replace(path)
        except OSError:
            part.unlink(missing_ok=True)
            os.close(fd)
            raise
    except OSError as error:
        raise RecordError(f"{path}: cannot be written: {(error.strerror or str(error)).lower()}") from None
    try:
        yield _Lines(path, fd)
    finally:
        os.close(fd)


class _Lines(io.TextIOBase):
    """A text file that hands every line to the system at once, and never keeps half of one."""

    def __init__(self, path: Path, fd: int) -> None:
        super().__init__()
        self._path, self._fd = path, fd
        self._size = 0

    def write(self, line: str, /) -> int:
        data = line.encode("ascii")
        try:
            written = os.write(self._fd, data)
            if written < len(data):  # a disk that is full takes what fits
                os.ftruncate(self._fd, self._size)
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            raise RecordError(f"{self._path}: cannot be written: {reason}") from None
        self._size += len(data)
        return len(line)
