"""`bench run`: exit codes, the JSON document, recordings that repeat byte for byte, both places to run."""

import json
import re

import pytest

from bench.laps.files import read_lap, write_lap
from bench.laps.lap import Lap
from targets.ecus import build
from targets.host import library
from tests.conftest import wavy_lap

SHORT = "rear_stroke:short@2"
NEEDED = ("fork_stroke_mm", "pitch_rate_dps", "speed_kmh", "rear_stroke_mm")


@pytest.mark.parametrize(
    ("fault", "threshold", "outcome", "code"),
    [
        (None, 20.0, "OK", 0),
        (SHORT, 20.0, "CD", 0),
        ("rear_stroke:uncalibration:gain=1.1@2", 20.0, "MD", 1),
        ("rear_stroke:uncalibration:gain=1@2", 20.0, "INVALID", 1),
        (SHORT, 0.0, "FA", 1),
    ],
)
def test_exit_code(bench, lap, model, tmp_path, fault, threshold, outcome, code):
    """A right verdict ends with 0, any other with 1; both are printed and written."""
    out = tmp_path / "out.json"
    faults = ("--fault", fault) if fault else ()
    ended = bench("run", lap, *faults, "--model", model(threshold=threshold), "--json", out)
    assert (ended.code, ended.err) == (code, "")
    assert ended.out.startswith(f"{outcome}  ")
    assert json.loads(out.read_text())["outcome"] == outcome


def test_json(bench, lap, model, tmp_path):
    """The JSON holds outcome, instants, step cycles, bus load and what the result came from."""
    out, calibration = tmp_path / "out.json", model()
    bench("run", lap, "--fault", SHORT, "--model", calibration, "--json", out)
    result = json.loads(out.read_text())
    assert (result["outcome"], result["t_active_s"]) == ("CD", 2.0)
    assert result["td_s"] == pytest.approx(result["t_alarm_s"] - result["t_active_s"], abs=1e-9)
    cycles = result["step_cycles"]
    assert 3_000 < cycles["min"] <= cycles["mean"] <= cycles["max"] < 8_000
    assert 0.05 < result["bus"]["load"] < 0.15
    source, ecu = result["provenance"], build(calibration=calibration).provenance()
    assert {"strokebench", "numpy", "unicorn"} <= set(source["versions"])
    assert "seed" in source
    assert (source["lap"], source["lap_sha256"]) == ("lap.csv", read_lap(lap).digest())
    assert {name: source[name] for name in ecu} == ecu
    for name in ("lap_sha256", "firmware_sha256", "calibration_sha256"):
        assert re.fullmatch("[0-9a-f]{64}", source[name])


def test_hashes_tell_inputs_apart(bench, lap, model, tmp_path):
    """Another lap or another calibration has another hash; the firmware's stays."""
    found = []
    for seconds, threshold in ((3.0, 20.0), (2.9, 20.0), (3.0, 21.0)):
        write_lap(wavy_lap(seconds), lap)
        bench("run", lap, "--model", model(threshold=threshold), "--json", tmp_path / "out.json")
        found.append(json.loads((tmp_path / "out.json").read_text())["provenance"])
    laps, calibrations, firmwares = (
        [source[f"{name}_sha256"] for source in found] for name in ("lap", "calibration", "firmware")
    )
    assert laps[0] == laps[2] != laps[1]
    assert calibrations[0] == calibrations[1] != calibrations[2]
    assert len(set(firmwares)) == 1


@pytest.mark.parametrize("suffix", [".log", ".blf", ".asc"])
def test_same_run_twice(bench, lap, model, tmp_path, suffix):
    """The same run twice gives the same JSON and the same recording, byte for byte."""
    calibration, files = model(), []
    for name in ("first", "second"):
        pair = tmp_path / f"{name}.json", tmp_path / f"{name}{suffix}"
        bench("run", lap, "--fault", SHORT, "--model", calibration, "--json", pair[0], "--record", pair[1])
        files.append([path.read_bytes() for path in pair])
    assert files[0] == files[1]
    assert min(map(len, files[0])) > 1000


def test_host_says_the_same(bench, lap, model, tmp_path):
    """The host core's status frames are those of the emulated MCU, byte for byte."""
    if library() is None:
        pytest.skip("the host core is not built: no C compiler was found at installation")
    calibration, said = model(), {}
    for host in ("mcu", "host"):
        out = tmp_path / f"{host}.log"
        bench("run", lap, "--fault", SHORT, "--model", calibration, "--on", host, "--record", out)
        said[host] = re.findall(r" 200#(\S+)", out.read_text())
    assert len(said["mcu"]) == 300
    assert len(set(said["mcu"])) > 200
    assert said["host"] == said["mcu"]


def test_only_the_needed_channels(bench, model, tmp_path):
    """A lap of the four strokes, rates and speeds that the IFD needs is enough."""
    path = tmp_path / "few.csv"
    write_lap(wavy_lap(3.0, names=NEEDED), path)
    assert bench("run", path, "--fault", SHORT, "--model", model()).code == 0


def test_time_that_starts_late(bench, model, tmp_path):
    """A lap cut out of a longer one keeps its own time base; faults count from its start."""
    late = wavy_lap(3.0)
    write_lap(Lap(late.t_ns + 90_000_000_000, late.channels), tmp_path / "late.csv")
    out = tmp_path / "out.json"
    bench("run", tmp_path / "late.csv", "--fault", SHORT, "--model", model(), "--json", out)
    assert json.loads(out.read_text())["t_active_s"] == 2.0


def test_soft_sensor(bench, lap, model, tmp_path):
    """The soft sensor role runs too: it answers each cycle and raises no alarm."""
    out = tmp_path / "out.json"
    ended = bench("run", lap, "--ecu", "soft_sensor", "--model", model(), "--json", out)
    result = json.loads(out.read_text())
    assert (ended.code, result["outcome"], result["answers"]) == (0, "OK", 300)


def test_generated_lap(bench, tmp_path):
    """A generated lap runs with what is shipped: quiet without a fault, an open circuit is found."""
    lap, out = tmp_path / "ridden.csv", tmp_path / "out.json"
    assert bench("lap", "generate", lap, "--seconds", 5, "--seed", 20_000).code == 0
    assert bench("run", lap).code == 0
    ended = bench("run", lap, "--fault", "rear_stroke:open@3", "--json", out)
    result = json.loads(out.read_text())
    assert (ended.code, result["outcome"], result["t_active_s"]) == (0, "CD", 3.0)
    assert 3.0 < result["t_alarm_s"] < 5.0


def test_interrupted_run_writes_nothing(monkeypatch, lap, model, tmp_path):
    """Ctrl-C in the middle of a ride leaves neither JSON nor recording."""
    from typer.testing import CliRunner

    from bench.cli.main import app

    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("bench.rig.Rig.finish", interrupted)
    words = ["run", lap, "--model", model(), "--json", tmp_path / "o.json", "--record", tmp_path / "o.log"]
    assert CliRunner().invoke(app, [str(word) for word in words]).exit_code == 130
    assert sorted(path.name for path in tmp_path.iterdir()) == ["lap.csv", "model.json"]
