"""`bench faults`: the catalogue in the terminal, as JSON and as pages."""

import json

import pytest

from bench.faults.kinds import KINDS


def test_list(bench, monkeypatch, tmp_path):
    """The list has a line for every kind, with its byte, and writes the same as JSON."""
    monkeypatch.setenv("COLUMNS", "130")
    out = tmp_path / "faults.json"
    ended = bench("faults", "list", "--json", out)
    assert (ended.code, ended.err) == (0, "")
    lines = {line.split()[0]: line for line in ended.out.splitlines() if line and line.split()[0] in KINDS}
    assert set(lines) == set(KINDS)
    assert "0x11" in lines["short_gnd"]
    assert "0x2A*" in lines["hold"]
    assert "hold (section V.2.2)" in lines["hold"]
    assert [row["kind"] for row in json.loads(out.read_text())] == list(KINDS)


@pytest.mark.parametrize("kind", KINDS)
def test_explain(bench, kind):
    """Every kind is explained in words and drawn, the same on every call."""
    ended = bench("faults", "explain", kind, "--ascii")
    assert (ended.code, ended.err) == (0, "")
    assert f"{kind}: {KINDS[kind].about}."[:60] in ended.out
    assert "_healthy_" in ended.out
    assert "_faulty_" in ended.out
    assert bench("faults", "explain", kind, "--ascii").out == ended.out


def test_explain_with_parameters_elsewhere(bench):
    """Parameters and place are those asked for."""
    ended = bench("faults", "explain", "leakage:ohm=2000", "--on", "fork_stroke", "--ascii")
    assert ended.out.startswith("fork_stroke:leakage:ohm=2000,to=gnd@2+3\n")
    assert "0x1A, circuit resistance below threshold." in ended.out
    assert "(not confirmed)" in bench("faults", "explain", "hold", "--ascii").out


def test_page(bench, tmp_path):
    """The page holds text and figure and fetches nothing."""
    pytest.importorskip("plotly", reason="plotly is not installed")
    out = tmp_path / "fault.html"
    assert bench("faults", "explain", "short_pin", "--html", out).code == 0
    text = out.read_text()
    assert "<h1>Fault: short_pin</h1>" in text
    assert "fork_stroke, mm" in text
    assert 'src="http' not in text


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (
            ("explain", "leakge"),
            "unknown kind 'leakge'; did you mean leakage? The known ones are open, short",
        ),
        (("explain", "leakage", "--on", "speed"), "speed:leakage: leakage acts on a stroke potentiometer"),
        (("explain", "leakage:ohm=x"), "leakage:ohm=x is not a number"),
        (("explain", "hold@3"), "'hold@3': an example has its own instant"),
        (("explain", "bus_off", "--on", "STROKES"), "bus_off acts on bus, not on STROKES"),
        (("explain", "hold", "--on", ""), "unknown sensor ''"),
    ],
)
def test_refused(refused, words, says):
    """A kind, place or parameter that is not known is refused in one line."""
    assert says in refused("faults", *words)


def test_list_to_nowhere(refused, tmp_path):
    """A JSON file in a folder that is not there is refused before anything is printed."""
    assert "no folder" in refused("faults", "list", "--json", tmp_path / "none" / "x.json")
