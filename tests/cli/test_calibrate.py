"""`bench calibrate ifd`: the file it writes, and what it refuses."""

import json

import pytest

from bench.laps.files import write_lap
from bench.plant.motorcycle import load_motorcycle
from bench.plant.ride import ride
from bench.plant.route import load_route
from targets.baselines import read
from targets.calibration import load
from targets.detector import Checks
from targets.ecus import DEFAULT_CALIBRATION
from tests.conftest import simulated_laps


@pytest.fixture(scope="module")
def laps(tmp_path_factory):
    """Seven minutes of fault-free laps."""
    return simulated_laps(tmp_path_factory.mktemp("laps"), "test_lap", 210.0)


@pytest.fixture
def tuned(bench, laps, tmp_path):
    out = tmp_path / "mine.json"
    said = bench("calibrate", "ifd", "--laps", laps, "--out", out, "--json", tmp_path / "report.json")
    assert said.code == 0, said.err
    return out


def test_written_calibration(tuned, laps):
    """The same network gets the second detector, baselines, and a provenance that names laps and budget."""
    calibration, shipped = load(tuned), load(DEFAULT_CALIBRATION)
    assert isinstance(calibration.detector, Checks)
    assert calibration.network.W1.tobytes() == shipped.network.W1.tobytes()
    assert {name: read(name, table).limit > 0 for name, table in calibration.baselines.items()} == {
        "persistence": True,
        "cusum": True,
        "residual": True,
    }
    said = calibration.provenance["detector"]
    assert said["budget_per_hour"] == 0.005
    assert {path.rpartition("/")[2] for path in said["laps_sha256"]} == {"1.parquet", "2.parquet"}


def test_report(tuned, tmp_path):
    """The report holds what the limits rest on."""
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["hours"] == pytest.approx(410 / 3600)
    assert report["detector"]["loss_threshold"] > report["healthy"]["loss_threshold"]


def test_smaller_budget_is_a_higher_limit(bench, tuned, laps, tmp_path):
    """Fewer false alarms allowed: a higher threshold."""
    bench("calibrate", "ifd", "--laps", laps, "--out", tmp_path / "strict.json", "--budget", 1e-6)
    strict, usual = load(tmp_path / "strict.json").detector, load(tuned).detector
    assert strict.loss_threshold * strict.loss_window > usual.loss_threshold * usual.loss_window


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--budget", 0), "--budget is 0; it must be more than 0"),
        (("--budget", "nan"), "--budget is nan; it must be more than 0"),
        (("--loss", 100), "--loss is 100; it must be more than 0 and less than 100 percent"),
        (("--model", "none.json"), "none.json: no such file"),
        (("--sensors", "none"), "none"),
    ],
)
def test_refusals(refused, laps, tmp_path, words, says):
    """What makes no detector is refused in one line, and nothing is written."""
    assert says in refused("calibrate", "ifd", "--laps", laps, "--out", tmp_path / "x.json", *words)


def test_too_little_riding(refused, tmp_path):
    """Too little riding is refused with how much there is."""
    (tmp_path / "laps").mkdir()
    lap = ride(load_route("test_lap"), load_motorcycle(), 1, 100.0)
    write_lap(lap, tmp_path / "laps" / "a.parquet")
    line = refused("calibrate", "ifd", "--laps", tmp_path / "laps", "--out", tmp_path / "x.json")
    assert "95 s of fault-free riding, the detector needs 300" in line
