"""Which software produced a result."""

from importlib.metadata import PackageNotFoundError, version

PACKAGES = ("strokebench", "numpy", "numba", "scipy", "unicorn", "capstone", "python-can", "cantools")


def versions() -> dict[str, str]:
    """Version of every package that can change a result; 'absent' where it is not installed."""
    found = {}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "absent"
    return found
