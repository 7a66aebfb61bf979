"""Numba's decorators, with a disk cache that knows when any source has changed.

Numba keys a cached function on its own file alone; a kernel that calls one of another file would go on with
the old one after that changed. Here the cache's folder is named after a digest of all sources, so that a
stale kernel cannot be found. Import `njit` and `cfunc` from here, never from numba.
"""

import os
import shutil
import tempfile
import time
from collections.abc import Callable, Iterable
from hashlib import sha256
from pathlib import Path
from typing import Any

from numba import config

_HERE = Path(__file__).parent
KEEP_S = 86_400
"""Caches of other sources are removed a day after they were begun."""


def _digest() -> str:
    """Of every Python source that may hold or feed a kernel: this package's and its neighbours'."""
    total = sha256()
    for package in ("targets", "bench"):
        for path in sorted((_HERE.parent / package).rglob("*.py")):
            total.update(str(path.relative_to(_HERE.parent)).encode() + b"\0" + path.read_bytes())
    return total.hexdigest()[:16]


def _folder() -> Path:
    """A writable folder for this digest: __pycache__, else the user's cache, else a temporary one."""
    name = f"numba-{_digest()}"
    user = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "strokebench"
    for parent in (_HERE / "__pycache__", user):
        try:
            parent.mkdir(parents=True, exist_ok=True)
            if (parent / name).is_dir():
                return parent / name
            (parent / name).mkdir(exist_ok=True)
        except OSError:
            continue
        # A younger one may belong to another checkout, or to a process that still runs.
        for old in parent.glob("numba-*"):
            if old.stat().st_mtime < time.time() - KEEP_S:
                shutil.rmtree(old, ignore_errors=True)
        return parent / name
    return Path(tempfile.mkdtemp(prefix="strokebench-numba-"))


if not config.CACHE_DIR:  # whoever sets NUMBA_CACHE_DIR knows why
    config.CACHE_DIR = str(_folder())

from numba import cfunc, types  # noqa: E402  # after the folder is set
from numba import njit as _njit  # noqa: E402


def njit(*signature: Any, **options: Any) -> Callable[[Callable[..., Any]], Any]:
    """As numba's own, but a function is compiled once for whole numbers, not again for each constant given.

    What a constant is worth LLVM finds out when it puts the function into its caller; compiling 500 functions
    instead of 370 would be half a minute of every first use.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        dispatcher = _njit(*signature, **options)(function)
        plain = dispatcher.get_call_template

        def get_call_template(args: Iterable[Any], kws: dict[str, Any]) -> Any:
            named = {name: types.unliteral(value) for name, value in kws.items()}
            return plain(tuple(types.unliteral(value) for value in args), named)

        dispatcher.get_call_template = get_call_template
        return dispatcher

    return decorate


__all__ = ["cfunc", "njit"]
