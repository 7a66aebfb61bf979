"""The directory of this user's sockets: nobody else may open, replace or foresee what lies in it."""

import os
import stat
from pathlib import Path

from bench.errors import BusError


def own_directory() -> Path:
    """`$XDG_RUNTIME_DIR/strokebench`, or one of this user in /tmp, made if need be.

    Raises BusError if it belongs to somebody else, or others may enter it.
    """
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    folder = Path(runtime) / "strokebench" if runtime else Path(f"/tmp/strokebench-{os.getuid()}")
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
    except OSError as error:
        raise BusError(f"{folder}: no room for a socket: {error.strerror}") from None
    if not stat.S_ISDIR(found.st_mode):
        raise BusError(f"{folder}: not a directory")
    if found.st_uid != os.getuid():
        raise BusError(f"{folder}: belongs to user {found.st_uid}, not to {os.getuid()}")
    if found.st_mode & 0o077:
        raise BusError(f"{folder}: others may enter it (mode {stat.S_IMODE(found.st_mode):o}, wanted 700)")
    return folder
