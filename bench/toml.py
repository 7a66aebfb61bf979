"""TOML files of the bench: read whole, refused in one line."""

import tomllib
from pathlib import Path
from typing import Any

from bench.errors import BenchError


def read_table(path: Path, error: type[BenchError]) -> dict[str, Any]:
    """The table in the file at `path`; `error`, naming the file, if it cannot be read or is no TOML."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as problem:
        raise error(f"{path}: cannot be read: {problem.strerror}") from None
    except ValueError as problem:  # no TOML, no UTF-8, or a number longer than Python converts
        raise error(f"{path}: not TOML: {problem}") from None
    except RecursionError:
        raise error(f"{path}: not TOML: nested too deep to be read") from None
