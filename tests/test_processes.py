"""What tests start in processes of their own is what is tested here."""

import subprocess
import sys
from pathlib import Path

import pytest

import bench


@pytest.mark.parametrize("folder", [Path(__file__).parents[1], Path("/")])
def test_same_packages(folder):
    """A process imports the packages that are tested, also in a checkout with a copy of its own."""
    command = [sys.executable, "-c", "import bench; print(bench.__file__)"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == bench.__file__
