"""Which software produced a result."""

from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version

PACKAGES = ("strokebench", "numpy", "numba", "scipy", "unicorn", "capstone", "python-can", "cantools")
"""What can change a result,"""
OF_CALIBRATIONS = ("strokebench", "numpy", "numba")
"""and of these what can change a network or a limit."""


def versions(packages: Sequence[str] = PACKAGES) -> dict[str, str]:
    """Version of each package; 'absent' where it is not installed."""
    found = {}
    for package in packages:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "absent"
    return found
