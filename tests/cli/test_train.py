"""`bench train narx`: from a folder of laps to a calibration file that loads and repeats."""

import json
import sys
from functools import partial

import pytest

from bench.laps.files import write_lap
from bench.laps.lap import Lap
from targets.calibration import load
from targets.narx import settings
from targets.narx.settings import Stage
from tests.conftest import wavy_lap

SMALL = ("--neurons", 2, "--delay", 2, "--seeds", 1)


@pytest.fixture
def laps(tmp_path):
    """A folder of three short laps whose rear stroke follows the fork's."""
    folder = tmp_path / "laps"
    folder.mkdir()
    for seed in range(3):
        lap = wavy_lap(4.0, seed=seed)
        rear = 20.0 + 0.7 * lap.channels["fork_stroke_mm"]
        write_lap(Lap(lap.t_ns, {**lap.channels, "rear_stroke_mm": rear}), folder / f"lap-{seed}.parquet")
    return folder


@pytest.fixture
def few_iterations(monkeypatch):
    """The recipe's forms in their order, a few iterations each."""
    free, closed = (Stage(name, name == "parallel", 6, 200) for name in ("series-parallel", "parallel"))
    short = partial(settings.Settings, screening=(free, closed), refinement=(closed,))
    monkeypatch.setattr(settings, "Settings", short)


def test_calibration(bench, laps, few_iterations, tmp_path):
    """Training writes a calibration that loads and a report, the same bytes every time."""
    written = []
    for name in ("first", "second"):
        out, report = tmp_path / f"{name}.json", tmp_path / f"{name}-report.json"
        ended = bench("train", "narx", "--laps", laps, "--out", out, "--json", report, *SMALL)
        assert ended.code == 0, ended.err
        written.append((out.read_bytes(), report.read_bytes()))
    assert written[0] == written[1]
    calibration = load(tmp_path / "first.json")
    assert (calibration.network.neurons, calibration.network.delays) == (2, 2)
    assert set(calibration.provenance["laps_sha256"]) == {f"lap-{k}.parquet" for k in range(3)}
    assert json.loads(written[0][1])["calibration"] == calibration.checksum


def test_no_folder(refused, tmp_path):
    """A folder that is not there is named."""
    line = refused("train", "narx", "--laps", tmp_path / "none", "--out", tmp_path / "model.json")
    assert "none: no such folder" in line


def test_folder_without_laps(refused, tmp_path):
    """A folder without a lap is refused with the formats looked for."""
    (tmp_path / "laps").mkdir()
    (tmp_path / "laps" / "notes.txt").write_text("none yet")
    line = refused("train", "narx", "--laps", tmp_path / "laps", "--out", tmp_path / "model.json")
    assert "no lap in it (.csv, .parquet, " in line


@pytest.mark.parametrize("option", ["--out", "--json"])
def test_unwritable(refused, tmp_path, option):
    """A result that could not be written is refused before any work."""
    files = {"--out": tmp_path / "model.json", option: tmp_path / "nowhere" / "file.json"}
    words = [word for pair in files.items() for word in pair]
    assert "no folder" in refused("train", "narx", "--laps", tmp_path / "none", *words)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--neurons", 0), "neurons is 0"),
        (("--delay", 0), "delays is 0"),
        (("--seeds", 0), "a seed"),
        (("--seed", -1), "seed -1 is negative"),
        ((), "samples"),
    ],
)
def test_unusable_settings(refused, tmp_path, words, says):
    """Settings out of range, and laps too short to train on, are refused."""
    (tmp_path / "laps").mkdir()
    write_lap(wavy_lap(1.0), tmp_path / "laps" / "one.csv")
    line = refused("train", "narx", "--laps", tmp_path / "laps", "--out", tmp_path / "model.json", *words)
    assert line.startswith("bench: training: ")
    assert says in line


def test_lap_without_a_channel(refused, tmp_path):
    """A lap that lacks the channel to be predicted is refused with its name."""
    (tmp_path / "laps").mkdir()
    write_lap(wavy_lap(1.0, names=("fork_stroke_mm", "speed_kmh")), tmp_path / "laps" / "one.csv")
    line = refused("train", "narx", "--laps", tmp_path / "laps", "--out", tmp_path / "model.json")
    assert "one.csv: missing rear_stroke_mm, needed by training" in line


def test_without_torch(refused, laps, tmp_path, monkeypatch):
    """Without torch the line says what to install."""
    monkeypatch.setitem(sys.modules, "torch", None)
    line = refused("train", "narx", "--laps", laps, "--out", tmp_path / "model.json", *SMALL)
    assert "pip install 'strokebench[train]'" in line


def test_unseen_laps_and_baselines(bench, laps, few_iterations, tmp_path):
    """With --test the table and the report hold the network's figures on other laps beside the baselines'."""
    out, report = tmp_path / "m.json", tmp_path / "r.json"
    ended = bench("train", "narx", "--laps", laps, "--out", out, "--test", laps, "--json", report, *SMALL)
    assert ended.code == 0, ended.err
    assert list(json.loads(report.read_text())["test"]) == ["network", "half-car, fitted", "best constant"]
    assert "half-car, fitted" in ended.out


def test_recipe_and_preparation_are_chosen(bench, laps, few_iterations, tmp_path):
    """--edit, --antialias, --shift and --inputs reach the training, and what was edited is said."""
    ended = bench(
        "train", "narx", "--laps", laps, "--out", tmp_path / "m.json", *SMALL,
        "--edit", "--antialias", "--shift", 5, "--inputs", "fork_stroke_mm",
    )  # fmt: skip
    assert ended.code == 0, ended.err
    assert "edited: " in ended.out
    network = load(tmp_path / "m.json").network
    assert (network.inputs, network.shift) == (("fork_stroke_mm",), 5)


def test_interrupted_training_is_taken_up_again(bench, laps, few_iterations, tmp_path, monkeypatch):
    """Ctrl-C leaves the best network so far and a state, from which --resume ends where it would have."""
    from targets.narx import train as room

    whole = tmp_path / "whole.json"
    assert bench("train", "narx", "--laps", laps, "--out", whole, *SMALL).code == 0
    descend, calls = room.descend, []

    def stopped(problem, theta):
        calls.append(theta)
        for k, iterate in enumerate(descend(problem, theta)):
            if len(calls) == 2 and k == 2:
                raise KeyboardInterrupt
            yield iterate

    monkeypatch.setattr(room, "descend", stopped)
    out = tmp_path / "m.json"
    ended = bench("train", "narx", "--laps", laps, "--out", out, *SMALL)
    assert "interrupted: the best network so far was kept" in ended.out
    assert load(out).provenance["interrupted"]
    monkeypatch.setattr(room, "descend", descend)
    assert bench("train", "narx", "--laps", laps, "--out", out, "--resume", *SMALL).code == 0
    assert load(out).checksum == load(whole).checksum
    assert not (tmp_path / "m.json.part").exists()


def test_a_better_result_is_not_overwritten(bench, laps, few_iterations, tmp_path):
    """A worse network for the same laps goes to a file beside the better one, with exit code 1."""
    out = tmp_path / "m.json"
    assert (
        bench("train", "narx", "--laps", laps, "--out", out, "--neurons", 4, "--delay", 4, "--seeds", 1).code
        == 0
    )
    kept = out.read_bytes()
    ended = bench("train", "narx", "--laps", laps, "--out", out, "--neurons", 1, "--delay", 1, "--seeds", 1)
    assert ended.code == 1
    assert "was better on these laps and is kept" in ended.err
    assert out.read_bytes() == kept
    assert load(tmp_path / "m.worse.json").network.neurons == 1


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--recipe", "hope"), "unknown recipe 'hope'; the known ones are parallel, series-parallel"),
        (("--inputs", "fork_stroke_mm,rear_stroke_mm"), "input 'rear_stroke_mm' is none of"),
        (("--inputs", "temperature"), "missing temperature, needed by training"),
        (("--resume",), "model.json.part: nothing to resume"),
        (("--sensors", "magic"), "sensors 'magic' are neither datasheet, ideal nor a .toml file"),
    ],
)
def test_more_unusable_settings(refused, laps, tmp_path, words, says):
    """Recipes, inputs, sensors and states that are not there are refused in one line."""
    line = refused("train", "narx", "--laps", laps, "--out", tmp_path / "model.json", *SMALL, *words)
    assert says in line


def test_a_damaged_state_is_refused(refused, laps, tmp_path):
    """A state that is no JSON is refused by name."""
    (tmp_path / "model.json.part").write_text("{")
    line = refused("train", "narx", "--laps", laps, "--out", tmp_path / "model.json", "--resume", *SMALL)
    assert "model.json.part: not the state of a training" in line
