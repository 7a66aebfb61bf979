"""The command as a whole: its start, the errors nobody put into words, demo and doctor."""

import subprocess
import sys

import pytest

from bench.laps.files import write_lap
from tests.conftest import wavy_lap

HEAVY = (
    *("numpy", "numba", "scipy", "torch", "cantools", "can", "pyarrow", "pydantic", "unicorn", "capstone"),
    *("asammdf", "plotly", "distributed", "pymavlink", "sqlite3", "tomllib", "importlib.metadata"),
)


def test_start_imports_nothing_heavy():
    """`bench --help` leaves numerics, buses, emulator and what else is slow to import alone."""
    start = "import sys, typer, bench.cli.main; typer.main.get_command(bench.cli.main.app)"
    code = f"{start}; print([name for name in {HEAVY} if name in sys.modules])"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout == "[]\n"


def test_can_without_asammdf(tmp_path):
    """A command that uses python-can does not wait for asammdf, one that records .mf4 has it all the same."""
    pytest.importorskip("asammdf")
    code = "import sys, bench.cli.main as cli\ntry: cli.main()\nexcept SystemExit as end: print(end.code)\n"
    code += "print([name for name in ('can', 'asammdf', 'pandas') if name in sys.modules])"
    command = [sys.executable, "-c", code, "monitor", "--bus", "virtual:lean", "--seconds", "0"]
    found = []
    for more in ((), ("--record", "a.mf4")):
        done = subprocess.run([*command, *more], capture_output=True, text=True, check=True, cwd=tmp_path)
        found.append(done.stdout.splitlines()[-2:])
    assert found == [["0", "['can']"], ["0", "['can', 'asammdf', 'pandas']"]]
    assert (tmp_path / "a.mf4").stat().st_size > 0


def test_refusal_from_the_shell(tmp_path):
    """As a process of its own, too, the command refuses in one line on the error stream, with exit code 2."""
    command = [sys.executable, "-m", "bench.cli.main", "run", str(tmp_path / "none.csv")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == f"bench: lap: {tmp_path / 'none.csv'}: no such file\n"


def test_help_names_the_commands(bench):
    """`bench --help` names every command."""
    ended = bench("--help")
    assert ended.code == 0
    for name in ("demo", "run", "lap", "train", "replay", "ecu", "doctor"):
        assert f" {name} " in ended.out


def test_system_error(refused, monkeypatch, lap):
    """What the system refuses and nobody foresaw is one line, too."""

    def full(*_, **__):
        raise OSError(28, "No space left on device", "/somewhere")

    monkeypatch.setattr("bench.laps.files.read_lap", full)
    assert refused("run", lap) == "bench: system: /somewhere: No space left on device\n"


def test_message_of_several_lines(refused, monkeypatch, lap):
    """An error's line ends are folded: a refusal is one line whatever its text."""
    from bench.errors import LapError

    def chatty(*_):
        raise LapError("first\n  second")

    monkeypatch.setattr("bench.laps.files.read_lap", chatty)
    assert refused("run", lap) == "bench: lap: first second\n"


@pytest.mark.parametrize("workers", [0, -1])
def test_demo_without_workers(refused, workers):
    """A demo that nobody would carry out is refused."""
    assert f"--workers is {workers}; it must be at least 1" in refused("demo", "--workers", workers)


def test_demo(bench, monkeypatch):
    """The demo prints invalid runs first, then the three tables, the same on every run."""
    from campaigns import plan

    short = plan.load("demo").model_copy(update={"laps": 1, "seconds": 4.0, "fault_window_s": (2.5, 3.0)})
    monkeypatch.setattr(plan, "load", lambda _: short)
    first = bench("demo", "--workers", 1)
    assert (first.code, first.err) == (0, "")
    order = [first.out.index(text) for text in ("INVALID runs", "V.14", "V.15", "V.13")]
    # the title names the tables, too: what counts is where they begin
    order[1:3] = [first.out.index(f"(Table V.{k})") for k in (14, 15)]
    assert order == sorted(order)
    assert bench("demo", "--workers", 1).out == first.out


def test_doctor(bench):
    """The doctor names the host core, and finds the emulator able to boot the firmware."""
    ended = bench("doctor")
    assert ended.code == 0
    assert "host core" in ended.out
    assert "boots the shipped firmware" in ended.out


def test_doctor_without_emulator(bench, monkeypatch):
    """An emulator that fails ends with exit code 1, the reason and what would mend it."""

    def broken():
        raise RuntimeError("no such engine")

    from bench.cli import doctor

    checks = (("emulated STM32F405", broken, "install strokebench again"), *doctor.CHECKS[1:2])
    monkeypatch.setattr(doctor, "CHECKS", checks)
    monkeypatch.setattr(doctor, "_mcu", broken)
    ended = bench("doctor")
    assert ended.code == 1
    assert "install strokebench again (RuntimeError: no such engine)" in " ".join(ended.out.split())


def test_doctor_names_the_extra(bench, monkeypatch):
    """What is missing is to be mended by a command that can be copied as it stands, brackets and all."""
    from bench.cli import doctor

    monkeypatch.setattr(doctor, "_package", lambda _: "")
    ended = bench("doctor")
    assert ended.code == 0
    assert "pip install 'strokebench[train]'" in " ".join(ended.out.split())
    assert "pip install 'strokebench[mdf]'" in " ".join(ended.out.split())


def test_brackets_in_a_name(bench, tmp_path):
    """A lap's name is shown as it is, not read as markup."""
    path = tmp_path / "ride[red].csv"
    write_lap(wavy_lap(1.0), path)
    assert "ride[red].csv" in bench("lap", "show", path).out
