"""One writer at a time: a lock file beside a file, which ends with its process whatever ends that.

Belongs here: the lock. Never: what is written.
"""

import os
from pathlib import Path

from campaigns.errors import CampaignError

_held: set[int] = set()


class Lock:
    """Of the file `path` until released; CampaignError if somebody, this process too, has it already."""

    def __init__(self, path: Path) -> None:
        import fcntl

        real = path.resolve()
        self._path = real.with_name(f"{real.name}.lock")
        try:
            while True:
                self._file = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
                _held.add(self._file)
                try:
                    fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    if self._is_there():
                        return
                except BaseException:
                    self._drop()
                    raise
                self._drop()  # another one released it, and with it the file, in between
        except BlockingIOError:
            raise CampaignError(f"{path}: another run is writing to it") from None
        except OSError as problem:
            reason = (problem.strerror or str(problem)).lower()
            raise CampaignError(f"{path}: cannot be locked for writing ({self._path}): {reason}") from None

    def release(self) -> None:
        """Let others have it; the lock file is gone before they can."""
        self._path.unlink(missing_ok=True)
        self._drop()

    def _is_there(self) -> bool:
        try:
            return os.path.samestat(os.fstat(self._file), self._path.stat())
        except FileNotFoundError:
            return False

    def _drop(self) -> None:
        _held.discard(self._file)
        os.close(self._file)


def _forked() -> None:
    # A lock belongs to whoever has the file open: workers would hold it on after this process was killed.
    for file in _held:
        os.close(file)
    _held.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forked)
