"""The shipped examples, run as a user would: in a process of their own, from a copy of their folder."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]


@pytest.fixture
def run(tmp_path):
    """`pytest WORD...` in a copy of examples/; its exit code and output."""
    shutil.copytree(ROOT / "examples", tmp_path / "suite", ignore=shutil.ignore_patterns("__pycache__"))
    # No plugin but the bench's own.
    environment = {
        **os.environ,
        "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1",
        "PYTHONIOENCODING": "utf-8",
        "COLUMNS": "100",
    }
    environment.pop("PYTEST_ADDOPTS", None)

    def call(*words):
        command = [sys.executable, "-m", "pytest", "-p", "bench.pytest_plugin", *words]
        done = subprocess.run(
            command,
            cwd=tmp_path / "suite",
            env=environment,
            capture_output=True,
            encoding="utf-8",
            check=False,
        )
        return done.returncode, done.stdout + done.stderr

    return call


def test_the_suite_passes(run):
    """The suite passes on the shipped firmware and calibration; what fails on purpose is not collected."""
    code, said = run("--strict-markers")
    assert code == 0, said
    assert re.search(r"\n=+ 9 passed in ", said)


def test_the_deliberate_failure_shows_waveform_and_instants(run):
    """The test that fails on purpose shows the waveform around the fault, with every instant marked."""
    code, said = run("failing/test_deliberately.py")
    assert code == 1, said
    assert "expected alarm within 0.1 s of rear_stroke:hold@8.000000001; seen: no alarm, residual " in said, (
        said
    )
    frame = said[said.index("- freeze frame -") :].splitlines()
    for name in ("measured rear_stroke_mm, mm", "predicted_mm, mm", "residual_pct, pct"):
        drawn = frame[frame.index(name) + 1 :][:6]
        assert any("⠁" <= cell <= "⣿" for line in drawn for cell in line), name
        assert any("┊" in line for line in drawn), name
    for instant in ("t_cmd 8.000 s", "t_active 8.001 s", "t_obs 8.002 s", "deadline 8.101 s"):
        assert any(instant in line and "^" in line for line in frame), instant
