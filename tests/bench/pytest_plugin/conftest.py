"""Suites that use the plugin, written by a test and run in a pytest of their own within this process."""

import pytest

from bench.laps.files import write_lap
from targets.calibration import dumps
from tests.conftest import wavy_lap

SECONDS = 3.0


@pytest.fixture
def suite(pytester, calibration, monkeypatch):
    """Write `body` as a suite on a short lap with a small network, run it with `words`."""
    # Another pytest's options are no business of this one.
    monkeypatch.delenv("PYTEST_ADDOPTS", raising=False)
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")
    monkeypatch.setenv("COLUMNS", "100")
    write_lap(wavy_lap(SECONDS), pytester.path / "lap.parquet")
    quiet = calibration.with_detector(threshold=20.0, multiple=2, warmup=50)
    (pytester.path / "model.json").write_text(dumps(quiet), encoding="utf-8")

    def run(body, *words, head=HEAD):
        pytester.makepyfile(test_suite=head + body)
        return pytester.runpytest_inprocess("-p", "bench.pytest_plugin", "--strict-markers", *words)

    return run


HEAD = """
import pytest

pytestmark = [
    pytest.mark.lap(file="lap.parquet", sensors="ideal"),
    pytest.mark.ecu("ifd", model="model.json"),
]
"""
