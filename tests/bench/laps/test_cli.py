import re

import numpy as np
import pytest
from typer.testing import CliRunner

from bench.cli.lap import app, sparkline
from bench.errors import LapError, RouteError
from bench.laps import CHANNELS, Lap, read_lap, write_lap


def bench(*words):
    return CliRunner().invoke(app, [str(word) for word in words])


def test_generate_writes_a_lap(tmp_path):
    """`generate` writes one lap of the length asked for and says so in one line."""
    result = bench("generate", tmp_path / "lap.csv", "--seconds", 3, "--seed", 5)
    assert result.exit_code == 0, result.output
    assert result.stdout == f"{tmp_path / 'lap.csv'}: 3.0 s, 7 channels, seed 5\n"
    assert len(read_lap(tmp_path / "lap.csv").t_ns) == 3000


def test_generate_counts_seeds_up(tmp_path):
    """With --count the folder is made and holds lap-<seed> files, each the lap of its seed."""
    result = bench("generate", tmp_path / "new" / "laps", "--seconds", 2, "--seed", 7, "--count", 2)
    assert result.exit_code == 0, result.output
    paths = sorted((tmp_path / "new" / "laps").iterdir())
    assert [path.name for path in paths] == ["lap-7.parquet", "lap-8.parquet"]
    bench("generate", tmp_path / "one.parquet", "--seconds", 2, "--seed", 8)
    assert read_lap(paths[1]) == read_lap(tmp_path / "one.parquet")
    assert read_lap(paths[0]) != read_lap(paths[1])


@pytest.mark.parametrize("name", ["csv", ".csv"])
def test_generate_in_another_format(tmp_path, name):
    """--format chooses the files' format, with or without its point."""
    bench("generate", tmp_path, "--seconds", 1, "--count", 1, "--format", name)
    assert [path.name for path in tmp_path.iterdir()] == ["lap-0.csv"]


def test_generate_rides_a_route_file(tmp_path):
    """--route takes a TOML file."""
    route = tmp_path / "way.toml"
    route.write_text('[[stretch]]\nsurface = "smooth"\nlength_m = 50\nspeed_kmh = 36\n')
    result = bench("generate", tmp_path / "lap.parquet", "--route", route)
    assert result.exit_code == 0, result.output
    assert read_lap(tmp_path / "lap.parquet").duration_ns / 1e9 == pytest.approx(5.0, rel=0.15)


def test_interrupted_generate_leaves_whole_laps_only(tmp_path, monkeypatch):
    """Interrupted in the second lap, the first is whole and of the second there is nothing."""
    from bench.laps import parquet

    write = parquet.write

    def interrupted(lap, part):
        write(lap, part)
        if "lap-1" in part.name:
            part.write_bytes(part.read_bytes()[:1000])
            raise KeyboardInterrupt

    monkeypatch.setattr(parquet, "write", interrupted)
    assert bench("generate", tmp_path, "--seconds", 1, "--count", 3).exit_code != 0
    assert [path.name for path in tmp_path.iterdir()] == ["lap-0.parquet"]
    assert len(read_lap(tmp_path / "lap-0.parquet").t_ns) == 1000


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["lap.txt"], r"lap\.txt: unknown suffix '\.txt'"),
        (["lap.csv", "--seed", -1], "seed is -1, below 0"),
        (["lap.csv", "--seconds", 0], "a lap of 0 s is not from"),
        (["lap.csv", "--seconds", "nan"], "a lap of nan s is not from"),
        (["lap.csv", "--route", "nordschleife"], "unknown route 'nordschleife'"),
        (["lap.csv", "--route", "none.toml"], r"none\.toml: cannot be read"),
        (["lap.csv", "--motorcycle", "none.toml"], r"none\.toml: cannot be read"),
        (["nowhere/lap.csv"], "no folder .*nowhere"),
        (["laps", "--count", 0], "--count is 0; it must be at least 1"),
        (["laps", "--count", 1, "--format", "xls"], r"unknown suffix '\.xls'"),
        (["lap.csv", "--format", "csv"], "--format csv goes with --count"),
        (["a_file", "--count", 1], "a_file: is a file; with --count it must be a folder"),
        (["a_file/laps", "--count", 1], "a_file/laps: cannot be made: Not a directory"),
    ],
)
def test_generate_refuses(tmp_path, monkeypatch, words, says):
    """An option that cannot be met is refused in one line before anything is made."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a_file").touch()
    result = bench("generate", *words)
    assert isinstance(result.exception, LapError | RouteError)
    assert re.search(says, str(result.exception)), result.exception
    assert "\n" not in str(result.exception)
    assert [path.name for path in tmp_path.iterdir()] == ["a_file"]


def test_convert_there_and_back(tmp_path):
    """Converting CSV to Parquet and back gives the same bytes."""
    rng = np.random.default_rng(0)
    lap = Lap(np.arange(100) * 1_000_000, {name: rng.standard_normal(100) for name in CHANNELS})
    write_lap(lap, tmp_path / "a.csv")
    assert bench("convert", tmp_path / "a.csv", tmp_path / "b.parquet").exit_code == 0
    assert bench("convert", tmp_path / "b.parquet", tmp_path / "c.csv").exit_code == 0
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "c.csv").read_bytes()


def test_convert_refuses_the_target_before_reading(tmp_path):
    """A target of unknown format is refused even before the source is looked at."""
    result = bench("convert", tmp_path / "gone.csv", tmp_path / "b.txt")
    assert "b.txt: unknown suffix" in str(result.exception)


def test_show_says_what_a_lap_holds(tmp_path):
    """`show` prints duration, rate, the largest gap and where, and each channel's statistics."""
    t_ns = np.array([0, 1, 2, 3, 8, 9]) * 1_000_000
    write_lap(Lap(t_ns, {"fork_stroke_mm": np.array([3.0, 4, 3, 4, 3, 4])}), tmp_path / "lap.csv")
    result = bench("show", tmp_path / "lap.csv")
    text = " ".join(result.stdout.split())
    assert "lap.csv: 0.009 s, 6 samples, 1000 Hz, largest gap 5 ms at 0.003 s" in text
    # rms of 3 and 4 in equal parts: sqrt(12.5)
    assert "fork_stroke_mm 3.00 3.50 4.00 3.54 ▁█▁█▁█" in text


def test_show_refuses_what_is_no_lap(tmp_path):
    """`show` of a missing file is one line."""
    result = bench("show", tmp_path / "gone.csv")
    assert isinstance(result.exception, LapError)


def test_sparkline_draws_peaks():
    """Each block is the highest value of its part; a constant is a low line."""
    assert sparkline(np.array([0.0, 0, 0, 7, 3.5, 0]), width=3) == "▁█▅"
    assert sparkline(np.ones(100), width=4) == "▁▁▁▁"
