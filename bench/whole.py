"""Files that appear complete or not at all, whatever interrupts the writing."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from bench.errors import BenchError, RecordError


@contextmanager
def whole(path: Path, error: type[BenchError] = RecordError) -> Iterator[Path]:
    """A path to write to; it becomes `path` if the block ends without an exception, and is gone otherwise.

    A device or a pipe is written to as it is: there is nothing that a rename could replace.
    Raises `error`, one line naming `path`, if the operating system refuses.
    """
    path = Path(path)
    # Beside the target, for a rename is only atomic within one file system.
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        if path.is_dir():
            raise IsADirectoryError(21, "is a folder")
        if _is_special(path):
            yield path
            return
        try:
            yield part
            part.replace(path)
        finally:
            part.unlink(missing_ok=True)
    except OSError as problem:
        raise error(f"{path}: cannot be written: {(problem.strerror or str(problem)).lower()}") from None


def check_writable(path: Path, error: type[BenchError] = RecordError) -> None:
    """Raise `error` now if `path` could not be written later: before hours of work, not after."""
    path = Path(path)
    try:
        if path.is_dir():
            raise error(f"{path}: is a folder")
        folder = path.parent
        if not folder.is_dir():
            raise error(f"{path}: no folder {folder}")
        if not os.access(path if _is_special(path) else folder, os.W_OK):
            raise error(f"{path}: folder {folder} is not writable")
    except OSError as problem:  # a name that is too long, for one
        raise error(f"{path}: cannot be written: {(problem.strerror or str(problem)).lower()}") from None


def _is_special(path: Path) -> bool:
    return path.exists() and not path.is_file()
