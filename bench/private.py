"""The folder of this user's sockets: nobody else may open, replace or foresee what lies in it."""

import os
import stat
from pathlib import Path

from bench.errors import BenchError


def private_folder() -> Path:
    """`$XDG_RUNTIME_DIR/strokebench`, or a folder of this user in /tmp; made if need be.

    Raises BenchError if it belongs to somebody else, or is open to others.
    """
    base = os.environ.get("XDG_RUNTIME_DIR")
    folder = Path(base) / "strokebench" if base else Path(f"/tmp/strokebench-{os.getuid()}")
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = folder.lstat()
    except OSError as error:
        raise BenchError(f"{folder}: {(error.strerror or str(error)).lower()}") from None
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid() or found.st_mode & 0o077:
        raise BenchError(f"{folder}: not a folder of this user alone (mode 0700); remove it")
    return folder
