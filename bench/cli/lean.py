"""python-can without asammdf, which it imports wherever that is installed: a second of nearly every command.

Belongs here: that, and nothing else.

It does so for an MF4 reader and writer of its own. The bench's are others (`bench.laps.mdf`,
`bench.recorder`) and import asammdf when there is an .mf4 to read or write.
"""

import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from types import ModuleType

_READER, _HEAVY = "can.io.mf4", "asammdf"


def lean_can() -> None:
    """From now on importing python-can finds no asammdf; for processes that are the bench's own.

    Those of users, such as their test suites, may want python-can's reader.
    """
    if not {_READER, _HEAVY} & sys.modules.keys():
        sys.meta_path.insert(0, _Finder())


class _Finder(MetaPathFinder):
    """Finds python-can's module where it is, and hides asammdf while that is executed, once."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname != _READER:
            return None
        sys.meta_path.remove(self)
        spec = PathFinder.find_spec(fullname, path, target)
        if spec and spec.loader:
            execute = spec.loader.exec_module

            def hidden(module: ModuleType) -> None:
                sys.modules[_HEAVY] = None  # type: ignore[assignment]  # importing it is an ImportError
                try:
                    execute(module)
                finally:
                    del sys.modules[_HEAVY]

            spec.loader.exec_module = hidden  # type: ignore[method-assign]
        return spec
