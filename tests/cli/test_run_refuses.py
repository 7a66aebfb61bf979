"""Bad input of `bench run`: one line, exit code 2, no traceback, nothing written."""

import json
from pathlib import Path

import pytest

from bench.laps.files import write_lap
from targets.firmware import ELF
from tests.conftest import wavy_lap

OPEN = "rear_stroke:open@1"


@pytest.fixture
def run(refused, tmp_path):
    """`bench run WORD...` refused, with files asked for that must not come into being."""

    def call(*words):
        return refused("run", *words, "--json", tmp_path / "out.json", "--record", tmp_path / "out.log")

    return call


def rows(lap):
    return [line.split(",") for line in lap.read_text().splitlines()]


def rewrite(lap, cells):
    lap.write_text("".join(",".join(row) + "\n" for row in cells))


def test_no_file(run, tmp_path):
    """A lap that is not there is named."""
    assert "none.csv: no such file" in run(tmp_path / "none.csv", "--fault", OPEN)


@pytest.mark.parametrize("name", ["folder", "folder.csv"])
def test_directory(run, tmp_path, name):
    """A directory is no lap, whatever its name looks like."""
    (tmp_path / name).mkdir()
    assert name in run(tmp_path / name)


@pytest.mark.parametrize("name", ["empty.csv", "empty.parquet"])
def test_empty_file(run, tmp_path, name):
    """An empty file is called empty."""
    (tmp_path / name).touch()
    assert f"{name}: empty file" in run(tmp_path / name)


def test_unknown_suffix(run, tmp_path):
    """A format nobody knows is refused with those that are known."""
    (tmp_path / "lap.xls").write_text("x")
    assert ".csv, .parquet" in run(tmp_path / "lap.xls")


def test_header_alone(run, lap):
    """A CSV without a sample is no lap."""
    rewrite(lap, rows(lap)[:1])
    assert "lap.csv" in run(lap)


def test_missing_columns(run, tmp_path):
    """Channels the ECU needs and the lap lacks are all named."""
    path = tmp_path / "two.csv"
    write_lap(wavy_lap(2.0, names=("fork_stroke_mm", "rear_stroke_mm")), path)
    assert "missing pitch_rate_dps, speed_kmh" in run(path)


def test_missing_time(run, lap):
    """A CSV without its time column is refused."""
    rewrite(lap, [row[1:] for row in rows(lap)])
    assert "t_s" in run(lap)


@pytest.mark.parametrize("cell", ["nan", "inf", "", "fast"])
def test_no_number(run, lap, cell):
    """A cell that is no finite number is named with its line and column."""
    cells = rows(lap)
    cells[500][1] = cell
    rewrite(lap, cells)
    assert f"line 501, column {cells[0][1]}" in run(lap)


def test_time_that_goes_back(run, lap):
    """Time that does not increase is refused with the sample where it does not."""
    cells = rows(lap)
    cells[500], cells[501] = cells[501], cells[500]
    rewrite(lap, cells)
    assert "time does not increase at sample 500" in run(lap)


def test_negative_time(run, lap):
    """A lap that begins before 0 s is refused."""
    cells = rows(lap)
    cells[1][0] = "-0.5"
    rewrite(lap, cells)
    assert "negative time" in run(lap)


@pytest.mark.parametrize("share", [0.001, 0.3, 0.99])
def test_truncated_parquet(run, tmp_path, share):
    """A Parquet file cut off anywhere is refused."""
    path = tmp_path / "cut.parquet"
    write_lap(wavy_lap(2.0), path)
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    assert "cut.parquet" in run(path)


def test_damaged_parquet(run, tmp_path):
    """A Parquet file of the right length whose footer is damaged is refused."""
    path = tmp_path / "rough.parquet"
    write_lap(wavy_lap(2.0), path)
    content = path.read_bytes()
    path.write_bytes(content[:-1000] + bytes(992) + content[-8:])
    assert "rough.parquet" in run(path)


def test_ragged_row(run, lap):
    """A row with fewer cells than the header is named by its line."""
    cells = rows(lap)
    cells[500].pop()
    rewrite(lap, cells)
    assert "line 501 has 7 cells, the header 8" in run(lap)


@pytest.mark.parametrize("name", ["a" * 300 + ".csv", "two\nlines.csv"])
def test_odd_name(run, tmp_path, name):
    """A name too long for the system, or of two lines, is refused in one line as well."""
    run(tmp_path / name)


@pytest.mark.parametrize(
    ("fault", "says"),
    [
        ("tail_stroke:open@1", "unknown sensor 'tail_stroke'"),
        ("rear_stroke:melt@1", "unknown kind 'melt'"),
        ("rear_stroke:open@-1", "time '-1'"),
        ("rear_stroke:open@1+-1", "duration '-1'"),
        ("rear_stroke:open@nan", "time 'nan'"),
        ("rear_stroke:open", "no @TIME"),
        ("rear_stroke:uncalibration:gain=nan@1", "gain=nan"),
        ("rear_stroke:open@3600", "rear_stroke:open"),
    ],
)
def test_fault(run, lap, fault, says):
    """A fault that does not exist, or not at that time, is refused with the value at fault."""
    assert says in run(lap, "--fault", fault)


@pytest.mark.parametrize(
    ("at", "content", "says"),
    [
        (18, b"\x3e\x00", "built for"),  # e_machine 62: x86-64
        (5, b"\x02", "ELF"),  # big-endian
        (0, b"MZ", "not an ELF file"),
        (28, b"\xff\xff\xff\x7f", "firmware"),  # e_phoff, far outside
    ],
)
def test_firmware(run, lap, tmp_path, at, content, says):
    """An image that is not for this MCU is refused."""
    image = bytearray(ELF["ifd"].read_bytes())
    image[at : at + len(content)] = content
    (tmp_path / "other.elf").write_bytes(image)
    line = run(lap, "--elf", tmp_path / "other.elf")
    assert line.startswith("bench: firmware: ")
    assert says in line


@pytest.mark.parametrize("share", [0.0, 0.0005, 0.5])
def test_truncated_firmware(run, lap, tmp_path, share):
    """An image cut off anywhere is refused."""
    image = ELF["ifd"].read_bytes()
    (tmp_path / "cut.elf").write_bytes(image[: int(share * len(image))])
    assert "cut.elf" in run(lap, "--elf", tmp_path / "cut.elf")


@pytest.mark.parametrize("option", ["--elf", "--model"])
@pytest.mark.parametrize("name", ["none", "folder"])
def test_no_such_part(run, lap, tmp_path, option, name):
    """Firmware and calibration that are not there, or are folders, are refused by name."""
    (tmp_path / "folder").mkdir()
    assert name in run(lap, option, tmp_path / name)


def _short_row(network):
    network["hidden_weights"][3].pop()


def _row_less(network):
    network["hidden_weights"].pop()


def _output_weight_less(network):
    network["output_weights"].pop()


def _too_many_neurons(network):
    network["hidden_biases"] *= 10


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (_short_row, "hidden_weights row 3 has 39 weights"),
        (_row_less, "hidden_weights has 14 rows for 15 neurons"),
        (_output_weight_less, "output_weights has 14 weights"),
        (_too_many_neurons, "neurons"),
    ],
)
def test_calibration_of_the_wrong_size(run, lap, model, spoil, says):
    """A calibration whose parts do not fit together is refused with the part that does not."""
    path = model()
    document = json.loads(path.read_text())
    spoil(document["network"])
    path.write_text(json.dumps(document))
    line = run(lap, "--model", path)
    assert line.startswith("bench: calibration: ")
    assert says in line


@pytest.mark.parametrize(
    ("text", "says"),
    [("", "not JSON"), ("{", "not JSON"), ("weights", "not JSON"), ("[1]", "not a strokebench-calibration")],
)
def test_calibration_that_is_none(run, lap, tmp_path, text, says):
    """A file that is no calibration is refused."""
    (tmp_path / "other.json").write_text(text)
    assert says in run(lap, "--model", tmp_path / "other.json")


def test_altered_calibration(run, lap, model):
    """A weight changed by hand no longer matches the checksum."""
    path = model()
    document = json.loads(path.read_text())
    document["network"]["output_bias"] += 1.0
    path.write_text(json.dumps(document))
    assert "checksum" in run(lap, "--model", path)


def test_unknown_ecu(run, lap):
    """An ECU that does not exist is refused with those that do."""
    assert "no ECU abs; there are ifd, soft_sensor" in run(lap, "--ecu", "abs")


def test_unknown_host(run, lap):
    """A place that does not exist is refused with those that do."""
    assert "no place moon to run an ECU; there are mcu, host" in run(lap, "--on", "moon")


@pytest.mark.parametrize(
    ("option", "name", "says"),
    [
        ("--json", "nowhere/out.json", "no folder"),
        ("--record", "nowhere/out.log", "no folder"),
        ("--json", "", "is a folder"),
        ("--record", "out.txt", "unknown suffix '.txt'"),
        ("--record", "out", "unknown suffix ''"),
    ],
)
def test_unwritable(refused, lap, tmp_path, option, name, says):
    """A result that could not be written is refused before the ride."""
    assert says in refused("run", lap, option, tmp_path / name)


def test_refusal_spares_what_was_there(refused, lap, tmp_path):
    """A refused run leaves the results of the run before as they are."""
    (tmp_path / "out.json").write_text("before")
    refused("run", lap, "--fault", "rear_stroke:open@99", "--json", tmp_path / "out.json")
    assert (tmp_path / "out.json").read_text() == "before"


def test_disk_full(refused, lap, model, tmp_path, monkeypatch):
    """A disk that fills up while the result is written is one line, and leaves neither part nor result."""
    calibration = model()

    def full(self, *_, **__):
        raise OSError(28, "No space left on device", str(self))

    monkeypatch.setattr(Path, "write_text", full)
    line = refused("run", lap, "--model", calibration, "--json", tmp_path / "out.json")
    assert "out.json: cannot be written: no space left on device" in line
