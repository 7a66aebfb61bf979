"""`bench bus` from the command line: a hub in the foreground, what it says, how it ends, what it refuses."""

import shutil
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from bench.bus.live import LiveBus
from targets.ecu import Frame

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(autouse=True)
def runtime(monkeypatch):
    """A directory for the hubs of this test alone, at a path short enough for a socket."""
    folder = tempfile.mkdtemp(prefix="hub-")
    monkeypatch.setenv("XDG_RUNTIME_DIR", folder)
    yield
    shutil.rmtree(folder)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize(("words", "pace"), [((), "untimed"), (("--timed", "125000"), "at 125000 bit/s")])
def test_bus_in_the_foreground(bench, number, words, pace):
    """It says that it is there, is listed, carries frames, and ends at a signal with nothing left behind."""
    command = [sys.executable, "-m", "bench.cli.main", "bus", "lab", *words]
    with subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE) as process:
        assert process.stderr.readline().decode() == f"bus strokebench:lab, {pace}; Ctrl-C ends it\n"
        assert bench("bus", "--list").out == "strokebench:lab\n"
        with LiveBus("strokebench:lab") as here, LiveBus("strokebench:lab") as there:
            here.send(Frame(0x100, b"\1"))
            assert there.receive(20).frame == Frame(0x100, b"\1")
        refused = bench("bus", "lab")
        assert refused.code == 2
        assert refused.err == (
            f"bench: bus: strokebench:lab: a hub is running already, process {process.pid}\n"
        )
        process.send_signal(number)
        assert process.wait(20) == 0
        assert process.stderr.read() == b""
    assert bench("bus", "--list").out == ""


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("a/b",), "channel 'a/b': a name has 1 to 64 letters, digits and _ . + -, the first no sign"),
        (("--timed", "0"), "bit rate 0 bit/s is not within 1 to 1000000, the range of classic CAN"),
    ],
)
def test_refusals(refused, words, says):
    """A name or a bit rate that is none is one line."""
    assert refused("bus", *words) == f"bench: bus: {says}\n"
