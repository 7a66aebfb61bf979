"""`bench lap generate` and `bench lap convert`: what writes laps."""

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from bench.cli.lap import app, shipped
from bench.errors import LapError, RouteError
from bench.laps import CHANNELS, Lap, read_lap, write_lap

ROOT = Path(__file__).resolve().parents[2]


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
        (
            ["lap.csv", "--motorcycle", "goldwing"],
            "unknown motorcycle 'goldwing'; the known ones are gsxr1000",
        ),
        (["laps", "--count", 2, "--workers", 0], "--workers is 0; it must be at least 1"),
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


def test_generate_with_any_number_of_workers(tmp_path):
    """One process and four write the same bytes and the same lines, in the order of the seeds."""
    ended = {}
    for workers in (1, 4):
        folder = tmp_path / "laps"
        result = bench("generate", folder, "--seconds", 1, "--count", 5, "--workers", workers)
        assert result.exit_code == 0, result.output
        ended[workers] = result.stdout, {path.name: path.read_bytes() for path in folder.iterdir()}
        folder.rename(tmp_path / f"laps-{workers}")
    assert ended[1] == ended[4]
    assert [line.rsplit(" ", 1)[1] for line in ended[4][0].splitlines()] == list("01234")


def test_refused_in_a_worker(tmp_path):
    """What a lap is refused for in another process is the same one line."""
    route = tmp_path / "way.toml"
    route.write_text(
        '[[stretch]]\nsurface = "smooth"\nlength_m = 900\nspeed_kmh = 30\n'
        "[[stretch.obstacle]]\nat_m = 5\nheight_m = 0.29\nlength_m = 0.3\n"
    )
    alone, beside = (
        bench("generate", tmp_path / "laps", "--route", route, "--count", 2, "--seconds", 5, "--workers", n)
        for n in (1, 2)
    )
    assert isinstance(alone.exception, RouteError)
    assert (type(beside.exception), str(beside.exception)) == (RouteError, str(alone.exception))


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_interrupted_workers_leave_whole_laps_only(tmp_path, number):
    """Ctrl-C, which reaches the workers too, and SIGTERM leave whole laps, no parts, and say one line."""
    folder = tmp_path / "laps"
    words = ("lap", "generate", folder, "--count", "500", "--seconds", "20", "--workers", "2")
    process = subprocess.Popen(
        [sys.executable, "-m", "bench.cli.main", *words],
        cwd=ROOT,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        until = time.monotonic() + 60
        while not (folder.is_dir() and any(folder.glob("lap-*"))):
            assert process.poll() is None
            assert time.monotonic() < until
            time.sleep(0.02)
        if number == signal.SIGINT:
            os.killpg(process.pid, number)
        else:
            process.send_signal(number)
        _, said = process.communicate(timeout=60)
    finally:
        process.kill()
    assert (process.returncode, said) == (130, "bench: lap: stopped; what is written is whole\n")
    assert 1 <= len(list(folder.iterdir())) < 500
    for path in folder.iterdir():
        assert len(read_lap(path).t_ns) == 20_000


def test_worker_killed(tmp_path, monkeypatch):
    """A worker that is killed from outside is one line, not a wait without end."""
    from bench.cli import lap

    def killed(*_):
        os.kill(os.getpid(), signal.SIGKILL)

    monkeypatch.setattr(lap, "_ride", killed)
    result = bench("generate", tmp_path, "--seconds", 1, "--count", 3, "--workers", 2)
    assert str(result.exception) == "a worker was killed; 0 of 3 jobs are done"


@pytest.mark.parametrize("kind", ["routes", "motorcycles"])
def test_help_lists_what_is_shipped(kind):
    """The help names exactly the routes and motorcycles that come with the bench."""
    from bench.plant import motorcycle, route

    names = {"routes": route.NAMES, "motorcycles": motorcycle.NAMES}[kind]
    assert shipped(kind).split(", ") == sorted(names)


def test_default_motorcycle(tmp_path):
    """Without --motorcycle the default one is ridden; another by its name rides another lap."""
    from bench.plant.motorcycle import DEFAULT

    other = next(name for name in shipped("motorcycles").split(", ") if name != DEFAULT)
    for name, words in (("a", ()), ("b", ("--motorcycle", DEFAULT)), ("c", ("--motorcycle", other))):
        bench("generate", tmp_path / f"{name}.csv", "--seconds", 1, *words)
    assert read_lap(tmp_path / "a.csv") == read_lap(tmp_path / "b.csv")
    assert read_lap(tmp_path / "a.csv") != read_lap(tmp_path / "c.csv")


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


def test_convert_with_a_map(tmp_path):
    """--map says which column is which channel; the lap that is written has the channels' own names."""
    (tmp_path / "bike.csv").write_text("Time,Fork\n0,1.5\n10,2.5\n20,3.5\n")
    (tmp_path / "map.toml").write_text(
        '[time]\nsignal = "Time"\nunit = "ms"\n[channels.fork_stroke_mm]\nsignal = "Fork"\nunit = "cm"\n'
    )
    result = bench("convert", tmp_path / "bike.csv", tmp_path / "lap.csv", "--map", tmp_path / "map.toml")
    assert result.exit_code == 0, result.output
    lap = read_lap(tmp_path / "lap.csv")
    assert lap == Lap(np.array([0, 10, 20]) * 1_000_000, {"fork_stroke_mm": np.array([15.0, 25.0, 35.0])})


def test_convert_mends(tmp_path):
    """--repair fills a gap that is otherwise refused or kept, and stderr says what was mended."""
    t_ns = np.concatenate([np.arange(50), np.arange(60, 100)]) * 1_000_000
    write_lap(Lap(t_ns, {"speed_kmh": t_ns / 1e6}), tmp_path / "a.csv")
    kept = bench("convert", tmp_path / "a.csv", tmp_path / "b.csv")
    mended = bench("convert", tmp_path / "a.csv", tmp_path / "c.csv", "--repair")
    assert len(read_lap(tmp_path / "b.csv").t_ns) == 90
    assert len(read_lap(tmp_path / "c.csv").t_ns) == 100
    assert "filled" not in kept.stderr
    assert re.fullmatch(r"bench: lap: .*a\.csv: .*filled with 10 samples\n", mended.stderr), mended.stderr
    assert mended.stdout == ""
