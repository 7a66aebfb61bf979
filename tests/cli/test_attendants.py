"""The keys of a running replay: what they do to its fault panel, and that a terminal's keys reach it."""

import json
import os
import pty
import re
import sys
import time

import pytest

from bench.cli.attendants import PanelKeys
from bench.codec import Codec
from bench.laps.files import write_lap
from bench.panel import Panel
from bench.script import Script
from bench.sensors.codes import acquire
from tests.conftest import wavy_lap

MS = 1_000_000


class Typed:
    """A keyboard on which `keys` lie."""

    def __init__(self):
        self.keys = ""

    def pressed(self):
        keys, self.keys = self.keys, ""
        return keys


@pytest.fixture
def typed():
    return Typed()


@pytest.fixture
def panel():
    return Panel(Script(acquire(wavy_lap(0.5)), Codec()))


@pytest.fixture
def said():
    return []


@pytest.fixture
def keys(typed, panel, said):
    return PanelKeys(typed, panel, {"1": "rear_stroke:open", "x": "speed:nonsense"}, said.append)


def test_fire_and_clear(keys, typed, panel, said):
    """A key fires its fault, c clears it; each is said with its instant."""
    typed.keys = "1"
    keys.turn(100 * MS)
    panel.settle(100 * MS)
    (entry,) = panel.entries(200 * MS)
    assert (str(entry.state), entry.spec.sensor, entry.spec.kind) == ("active", "rear_stroke", "open")
    typed.keys = "c"
    keys.turn(200 * MS)
    assert said == ["0.100 s  fired rear_stroke:open", "0.200 s  cleared"]


def test_refusals_are_said(keys, typed, panel, said):
    """What cannot be done is one line, and the replay goes on; other keys do nothing."""
    typed.keys = "c?x"
    keys.turn(0)
    assert said[0] == "0.000 s  fault: no fault is active: nothing to clear"
    assert said[1].startswith("0.000 s  fault: ")
    assert len(said) == 2
    assert panel.entries(0) == []


def test_quit(keys, typed):
    """q ends the command as Ctrl-C does."""
    typed.keys = "q"
    with pytest.raises(KeyboardInterrupt):
        keys.turn(0)


def test_terminal(tmp_path):
    """A key pressed at the terminal of a running replay fires its fault, which the document then names."""
    write_lap(wavy_lap(2.0), tmp_path / "lap.csv")
    out = tmp_path / "out.json"
    words = ["replay", tmp_path / "lap.csv", "--bus", "virtual:keys", "--late-limit", 1000, "--json", out]
    words += ["--key", "o=fork_stroke:open@now+0.2"]
    replay, here = pty.fork()
    if not replay:
        os.execv(sys.executable, [sys.executable, "-m", "bench.cli.main", *map(str, words)])
    screen = b""
    while b"keys: o fork_stroke:open@now+0.2; c clears, q quits" not in screen:
        screen += os.read(here, 4096)
    time.sleep(0.2)
    os.write(here, b"o")
    try:
        while more := os.read(here, 4096):
            screen += more
    except OSError:  # Linux's way to say that the other end has been closed
        pass
    os.close(here)
    assert os.waitstatus_to_exitcode(os.waitpid(replay, 0)[1]) == 0
    assert re.search(rb"\d\.\d{3} s  fired fork_stroke:open@now\+0\.2", screen)
    (fault,) = json.loads(out.read_text())["faults"]
    assert re.fullmatch(r"fork_stroke:open@[\d.]+\+0\.2", fault)
