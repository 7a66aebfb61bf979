"""`bench firmware`: images built and weighed, steps timed, figures printed, bad input refused."""

import json

import pytest

from targets.firmware import ELF, STEP_ELF
from tests.conftest import wavy_lap

FEW = ("--repeat", 5, "--clock", 22)


@pytest.fixture
def short_lap(monkeypatch):
    """The simulated test lap is half a second long."""
    monkeypatch.setattr("bench.plant.ride.ride", lambda route, motorcycle, seed: wavy_lap(0.5, seed=seed + 1))


def test_timing(bench, short_lap, tmp_path):
    """Timing prints the table, memory, lowest clock and profile, and writes the same figures."""
    ended = bench("firmware", "timing", *FEW, "--json", tmp_path / "t.json", "--html", tmp_path / "t.html")
    assert ended.code == 0, ended.err
    result = json.loads((tmp_path / "t.json").read_text())
    assert [row["code"] for row in result["times"]] == ["initial", "compiler", "final"]
    assert result["each"] == []
    final = result["times"][2]
    assert (final["clock_mhz"], final["steps"], final["thesis_mean_us"]) == (22, 5, 686.6)
    assert f"{final['mean_us']:.4g}" in ended.out
    assert "1851.6 7.0" in ended.out
    assert result["lowest_clock"]["clock_mhz"] <= 6
    assert len(result["profile"]["lines"]) == 20
    assert all(line["line"] in ended.out for line in result["profile"]["lines"])
    assert [row["code"] for row in result["memory"]] == ["initial", "compiler", "final"]
    page = (tmp_path / "t.html").read_text()
    assert page.startswith("<!doctype html>")
    assert "686.6" in page


def test_timing_of_one_code(bench, short_lap):
    """One code at one clock: one row, and the profile is that code's."""
    ended = bench("firmware", "timing", *FEW, "--code", "compiler")
    assert ended.code == 0, ended.err
    assert "step of the compiler code" in ended.out
    assert "initial  " not in ended.out


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--clock", 23.1), "clock 23.1 MHz: no setting"),
        (("--code", "assembler"), "no code assembler; there are initial, compiler, final"),
        (("--json", "nowhere/t.json"), "nowhere"),
        (("--repeat", 1000, "--clock", 22), "shorter than the 1001 steps"),
    ],
)
def test_timing_refuses(refused, short_lap, words, says):
    """A clock, a code, a file or a number of steps that cannot be is refused by name."""
    assert says in refused("firmware", "timing", *words)


def test_size_of_the_shipped_image(bench, tmp_path):
    """Without an argument the shipped IFD is weighed: totals, sections, symbols."""
    ended = bench("firmware", "size", "--json", tmp_path / "s.json")
    assert ended.code == 0
    assert str(ELF["ifd"]) in ended.out
    assert "narx_step" in ended.out
    result = json.loads((tmp_path / "s.json").read_text())
    assert f"{result['flash_bytes']} bytes of flash, {result['ram_bytes']} of RAM" in ended.out
    assert {section["name"] for section in result["sections"]} == {".text", ".bss"}


def test_size_of_another_image(bench):
    """Any ELF can be weighed."""
    assert "iw1" in bench("firmware", "size", STEP_ELF["initial"]).out


def test_size_refuses(refused, tmp_path):
    """What is not there is refused by name."""
    assert "none.elf: no such file" in refused("firmware", "size", tmp_path / "none.elf")


@pytest.mark.parametrize("words", [(), ("--ecu", "soft_sensor"), ("--code", "initial")])
def test_build(arm_gcc, bench, tmp_path, words):
    """An image is built, and compared with the shipped one."""
    ended = bench("firmware", "build", "--out", tmp_path / "image.elf", *words)
    assert ended.code == 0, ended.err
    assert (tmp_path / "image.elf").read_bytes().startswith(b"\x7fELF")
    assert "the shipped image" in ended.out


def test_build_of_a_code_that_is_not_shipped(arm_gcc, bench, tmp_path):
    """The soft sensor's initial code is shipped nowhere, and the line says so."""
    ended = bench(
        "firmware", "build", "--out", tmp_path / "image.elf", "--ecu", "soft_sensor", "--code", "initial"
    )
    assert "none is shipped" in ended.out


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--ecu", "abs"), "no ECU abs; there are ifd, soft_sensor"),
        (("--code", "fast"), "no code fast; there are initial, compiler, final"),
    ],
)
def test_build_refuses(refused, tmp_path, words, says):
    """An ECU or a code that there is not is refused, and nothing is written."""
    assert says in refused("firmware", "build", "--out", tmp_path / "image.elf", *words)
