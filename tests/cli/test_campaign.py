"""`bench campaign` and `bench firmware`: lists, stores, pages, refusals."""

import json

import pytest

from bench.laps.files import write_lap
from bench.plant.motorcycle import load_motorcycle
from bench.plant.ride import ride
from bench.plant.route import load_route
from campaigns import narx as room

GRID = """
kind = "narx_grid"
title = "Small grid"
stands_for = "a test"
neurons = [2]
delays = [1, 2]
seeds = [0]
samples = 2000
iterations = 3
training = { route = "test_lap", count = 2, seed = 0 }
test = { route = "test_lap", count = 1, seed = 5 }
"""


@pytest.fixture(scope="module")
def rides():
    return [ride(load_route("test_lap"), load_motorcycle(), seed, seconds=30) for seed in (1, 2, 3)]


@pytest.fixture
def folder(rides, tmp_path):
    """Three short rides as files."""
    (tmp_path / "laps").mkdir()
    for k, lap in enumerate(rides):
        write_lap(lap, tmp_path / "laps" / f"{k}.parquet")
    return tmp_path / "laps"


@pytest.fixture(autouse=True)
def short(monkeypatch, rides):
    monkeypatch.setattr(room, "ridden", lambda plan: rides[: plan.count])


@pytest.fixture
def plan(tmp_path):
    (tmp_path / "grid.toml").write_text(GRID)
    return tmp_path / "grid.toml"


def test_list(bench):
    """Every campaign is listed by its name with what it stands for."""
    said = bench("campaign", "list")
    assert said.code == 0
    assert "narx_grid" in said.out
    assert "Table III.2" in said.out


def test_a_grid_is_stored_and_taken_up_again(bench, plan, tmp_path, monkeypatch):
    """What is finished is kept in the store, and a second run trains nothing."""
    store, out = tmp_path / "grid.sqlite", tmp_path / "out.json"
    first = bench("campaign", "run", plan, "--workers", 1, "--store", store, "--json", out)
    assert first.code == 0, first.err
    assert "Table III.2" in first.out
    assert len(json.loads(out.read_text())["tables"]["cells"]) == 2
    monkeypatch.setattr(room, "_cell", lambda *_: pytest.fail("trained again"))
    assert bench("campaign", "run", plan, "--workers", 1, "--store", store).out == first.out
    assert bench("campaign", "report", store).out == first.out


def test_performance_on_laps_of_ones_own(bench, folder, tmp_path):
    """The performance campaign measures the shipped network on a folder of laps, with a page of curves."""
    pytest.importorskip("plotly", reason="plotly is not installed")
    page = tmp_path / "page.html"
    said = bench("campaign", "run", "narx_performance", "--laps", folder, "--html", page)
    assert said.code == 0, said.err
    for name in ("NARX network", "half-car (II.2)", "best constant", "thesis: half-car"):
        assert name in said.out
    text = page.read_text(encoding="utf-8")
    assert "Sliding occurrence of errors" in text or "SOE (III.4)" in text
    assert "2.parquet" in text or "1.parquet" in text or "0.parquet" in text


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("nothing",), "unknown campaign 'nothing'; the known ones are demo,"),
        (("narx_leave_one_out",), "needs --laps DIR, a folder of recorded rides"),
        (("narx_performance", "--fail-fast"), "a campaign of kind narx_performance takes no --fail-fast"),
        (("narx_performance", "--sensors", "eyes"), "sensors 'eyes' are neither"),
        (("narx_leave_one_out", "--model", "x.json", "--csv", "x.csv"), "takes no --csv, --model"),
        (("narx_grid", "--model", "x.json"), "a campaign of kind narx_grid takes no --model"),
        (("narx_grid", "--map", "x.toml"), "takes no --map"),
        (("narx_grid", "--workers", 0), "--workers is 0; it must be at least 1"),
    ],
)
def test_refusals(refused, tmp_path, monkeypatch, words, says):
    """What a campaign cannot be asked for is refused before any work."""
    monkeypatch.chdir(tmp_path)
    assert says in refused("campaign", "run", *words)


def test_leave_one_out_needs_rides(refused, folder):
    """Two rides are too few to leave one out."""
    (folder / "0.parquet").unlink()
    assert "at least 3 laps" in refused("campaign", "run", "narx_leave_one_out", "--laps", folder)


def test_firmware_is_validated_over_a_lap(bench, lap, tmp_path):
    """The command prints both deviations, writes them as JSON and draws the free run's."""
    out = tmp_path / "out.json"
    said = bench("firmware", "validate", lap, "--json", out)
    assert said.code == 0, said.err
    result = json.loads(out.read_text())
    assert result["steps"] == 300
    assert 0 < result["one_step_worst_percent"] < result["thesis_percent"] * 10
    assert "each step from the firmware's own" in said.out


def test_validation_refuses_what_lacks_an_input(refused, tmp_path):
    """A lap without a channel the network needs is refused by name."""
    from tests.conftest import wavy_lap

    write_lap(wavy_lap(1.0, names=("fork_stroke_mm", "rear_stroke_mm")), tmp_path / "lap.csv")
    assert "missing pitch_rate_dps, speed_kmh" in refused("firmware", "validate", tmp_path / "lap.csv")
