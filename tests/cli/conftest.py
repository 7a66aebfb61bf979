"""The `bench` command called in the test's own process, and what its files are made of."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest

from bench.cli.main import main
from bench.laps.files import write_lap
from targets.calibration import dumps
from tests.conftest import wavy_lap


class Ended(NamedTuple):
    """How a command ended: its exit code and what it said."""

    code: int
    out: str
    err: str


@pytest.fixture
def bench(monkeypatch, capsys) -> Callable[..., Ended]:
    """Call `bench WORD...` in this process."""

    def call(*words: object) -> Ended:
        monkeypatch.setattr(sys, "argv", ["bench", *map(str, words)])
        capsys.readouterr()
        with pytest.raises(SystemExit) as ended:
            main()
        return Ended(ended.value.code or 0, *capsys.readouterr())

    return call


@pytest.fixture
def refused(bench, tmp_path) -> Callable[..., str]:
    """Call `bench WORD...`, see it refused as bad input is to be refused, and return its one line."""

    def call(*words: object) -> str:
        before = contents(tmp_path)
        ended = bench(*words)
        assert ended.code == 2
        assert ended.err.startswith("bench: ")
        assert ended.err.endswith("\n")
        assert ended.err.count("\n") == 1
        assert ended.out == ""
        assert contents(tmp_path) == before
        return ended.err

    return call


def contents(folder: Path) -> dict[Path, bytes | None]:
    """Every file below `folder` with its bytes, every folder with None."""
    return {path: path.read_bytes() if path.is_file() else None for path in folder.rglob("*")}


@pytest.fixture
def lap(tmp_path) -> Path:
    """A CSV lap of 3 s with the channels of the design."""
    path = tmp_path / "lap.csv"
    write_lap(wavy_lap(3.0), path)
    return path


@pytest.fixture
def model(tmp_path, calibration) -> Callable[..., Path]:
    """A calibration file; its threshold is passed by a shorted sensor only, unless told otherwise."""

    def write(**detector: float) -> Path:
        settings = {"threshold": 20.0, "multiple": 2, "warmup": 50, **detector}
        path = tmp_path / "model.json"
        path.write_text(dumps(calibration.with_detector(**settings)), encoding="utf-8")
        return path

    return write
