"""`bench monitor` from the command line: what it says, writes, refuses, and how it ends."""

import json
import os
import pty
import signal
import subprocess
import sys
import termios

import pytest

from bench.bus.live import Heard, LiveBus
from bench.cli import monitor_live
from bench.codec import Codec
from bench.errors import BusError
from bench.laps.files import read_lap
from targets.ecu import Frame

MONITOR = ("monitor", "--bus", "virtual:mon")
CODEC = Codec()


def strokes(k):
    data = CODEC.encode("STROKES", {"fork_stroke_mm": 50, "rear_stroke_mm": k / 10, "alive": k % 16})
    return Frame(0x100, data[0].tobytes())


@pytest.fixture
def busy(monkeypatch):
    return receiving(monkeypatch)


def receiving(monkeypatch):
    """A bus with a clock of its own that gives STROKES every 10 ms; what is in `then` is raised after 400."""
    given = {"k": 0, "now": 0, "then": None}

    def receive(bus, timeout_s):
        if given["then"] and given["k"] >= 400:
            raise given["then"]
        given["now"] += 10_000_000
        given["k"] += 1
        return Heard(strokes(given["k"]), 0)

    monkeypatch.setattr(LiveBus, "receive", receive)
    monkeypatch.setattr(monitor_live, "since_now", lambda: lambda: given["now"])
    return given


def test_lines(bench, busy, tmp_path):
    """Without a terminal: a line a second, a summary at the end, a recording and a document."""
    log, out = tmp_path / "a.log", tmp_path / "a.json"
    ended = bench(*MONITOR, "--seconds", 4, "--record", log, "--json", out)
    assert (ended.code, ended.err) == (0, "")
    lines = ended.out.splitlines()
    assert [line.split()[0] for line in lines[:3]] == ["1.0", "2.0", "3.0"]
    assert "100/s  bus 1." in lines[1]
    assert lines[-2].split()[:4] == ["message", "id", "frames", "per"]
    assert lines[-1].split() == ["STROKES", "0x100", "400", "100.0", "0", "0", "0"]
    assert log.read_text().count("\n") == 400
    document = json.loads(out.read_text())
    assert document["frames"] == document["messages"]["STROKES"]["frames"] == 400
    assert document["lost"] == 0


@pytest.mark.parametrize("suffix", [".log", ".blf"])
def test_bus_goes_down(bench, busy, tmp_path, suffix):
    """A bus that goes down is one line and exit code 2; recording, document and summary are whole."""
    log, out = tmp_path / f"a{suffix}", tmp_path / "a.json"
    busy["then"] = BusError("virtual:mon: cannot receive: Network is down")
    ended = bench(*MONITOR, "--record", log, "--json", out)
    assert ended.code == 2
    assert ended.err == "bench: bus: virtual:mon: cannot receive: Network is down\n"
    assert len(read_lap(log).t_ns) == 400
    assert json.loads(out.read_text())["frames"] == 400
    assert "STROKES" in ended.out.splitlines()[-1]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=["INT", "TERM"])
def test_stopped(bench, busy, tmp_path, monkeypatch, number):
    """Ctrl-C and SIGTERM end it like q: exit code 0, all written."""
    plain = LiveBus.receive

    def receive(bus, timeout_s):
        if busy["k"] == 100:
            os.kill(os.getpid(), number)
        return plain(bus, timeout_s)

    monkeypatch.setattr(LiveBus, "receive", receive)
    ended = bench(*MONITOR, "--record", tmp_path / "a.asc")
    assert (ended.code, ended.err) == (0, "")
    assert len(read_lap(tmp_path / "a.asc").t_ns) == 100


def test_reader_that_leaves(tmp_path):
    """Nobody reading the lines any more ends it like q, with the recording whole."""
    words = [*MONITOR, "--record", str(tmp_path / "a.log")]
    code = (
        "import sys; from tests.cli.test_monitor import *\n"
        "given = receiving(pytest.MonkeyPatch())\n"
        f"sys.argv = ['bench', *{words}]\n"
        "from bench.cli.main import main; main()\n"
    )
    read, write = os.pipe()
    os.close(read)
    process = subprocess.run(
        [sys.executable, "-c", code], stdout=write, stderr=subprocess.PIPE, check=False, timeout=120
    )
    os.close(write)
    assert (process.returncode, process.stderr) == (0, b"")
    assert (tmp_path / "a.log").read_text().count("\n") == 101


def test_threshold_of_a_calibration(bench, busy, monkeypatch, model):
    """--model gives the residual its threshold, --clock the step its time."""
    status = {"predicted_mm": 40, "residual_pct": 7, "alarm": 0, "ready": 1, "alive": 1, "step": 1, "kind": 0}
    timing = {"step_cycles": 84_000, "missed_inputs": 0, "overruns": 0, "alive": 1}
    frames = [
        Frame(0x200, CODEC.encode("IFD_STATUS", status)[0].tobytes()),
        Frame(0x201, CODEC.encode("IFD_TIMING", timing)[0].tobytes()),
    ]
    plain = LiveBus.receive

    def receive(bus, timeout_s):
        heard = plain(bus, timeout_s)
        return Heard(frames.pop(), 0) if frames else heard

    monkeypatch.setattr(LiveBus, "receive", receive)
    ended = bench(*MONITOR, "--seconds", 2, "--clock", 84, "--model", model(threshold=0.2))
    assert "residual 7.00 % of 20.00 %  no alarm  step 1.000 ms" in ended.out


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--bus", "pigeon:1"), "bus: pigeon:1: no interface 'pigeon'; python-can has "),
        (("--bus", "socketcan:no99"), "bus: socketcan:no99: cannot be opened: "),
        (("--dbc", "none.dbc"), "bus: none.dbc: No such file"),
        (("--model", "none.json"), "calibration: none.json: no such file"),
        (("--key", "o=rear_stroke:melt"), "fault: unknown kind 'melt'"),
        (("--key", "q=rear_stroke:open"), "fault: --key 'q=rear_stroke:open': 'q' means quit"),
        (("--record", "a.txt"), "record: a.txt: unknown suffix '.txt'"),
        (("--json", "none/a.json"), "record: none/a.json: no folder none"),
    ],
    ids=lambda value: value[1] if isinstance(value, tuple) else "",
)
def test_refused(refused, words, says):
    """Bad input is one line that names it, and nothing is written."""
    bus = () if words[0] == "--bus" else ("--bus", "virtual:mon")
    assert says in refused("monitor", *bus, *words)


@pytest.mark.parametrize("how", ["q", "TERM"])
def test_on_a_terminal(tmp_path, how):
    """On a terminal it draws, takes keys, and leaves the terminal as it found it, killed or not."""
    here, there = pty.openpty()
    before = termios.tcgetattr(there)
    code = "import os; os.setsid(); import fcntl, termios, sys; fcntl.ioctl(0, termios.TIOCSCTTY, 0)\n"
    code += "from bench.cli.main import main; sys.argv[0] = 'bench'; main()"
    command = [sys.executable, "-c", code, "monitor", "--bus", f"virtual:{how}", "--record", "a.blf"]
    process = subprocess.Popen(
        command,
        cwd=tmp_path,
        env=os.environ | {"TERM": "xterm", "COLUMNS": "80", "LINES": "24"},
        stdin=there,
        stdout=there,
        stderr=there,
    )
    try:
        shown = b""
        while b"q quit" not in shown:
            shown += os.read(here, 65536)
        assert b"nothing heard yet" in shown
        if how == "q":
            os.write(here, b"q")
        else:
            process.terminate()
        while b"frames in" not in shown:
            shown += os.read(here, 65536)
        assert process.wait(60) == 0
        assert b"\x1b[?1049l" in shown  # the alternate screen has been left
        assert termios.tcgetattr(there) == before
        assert (tmp_path / "a.blf").exists()
    finally:
        process.kill()
        process.wait()
        os.close(here)
        os.close(there)
