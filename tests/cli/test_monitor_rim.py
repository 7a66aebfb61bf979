"""The monitor's rim: keyboard, recording, the line to the replay, and the order of its turns."""

import os
import pty
import subprocess
import sys
import termios
import threading
from itertools import count
from pathlib import Path

import pytest

from bench.bus.live import Heard
from bench.cli.control_socket import ControlSocket, ask
from bench.cli.keyboard import DEFAULTS, Keyboard, key_faults
from bench.cli.monitor_faults import Answer, FaultLink
from bench.cli.monitor_live import BEHIND_NS, BEHIND_REFRESH_NS, REFRESH_NS, Session, listen
from bench.cli.monitor_record import recording
from bench.cli.monitor_screen import Frame
from bench.codec import Codec
from bench.control import parse_command
from bench.errors import BusError, FaultError, RecordError
from bench.laps.files import read_lap
from bench.monitor.model import Monitor
from targets.ecu import Frame as CanFrame

MS = 1_000_000
STROKES = CanFrame(0x100, bytes(4))


@pytest.fixture
def terminal(monkeypatch):
    """A pseudo-terminal's two ends, whose foreground is this process."""
    here, there = pty.openpty()
    monkeypatch.setattr(os, "tcgetpgrp", lambda fd: os.getpgrp())
    yield here, there
    os.close(here)
    os.close(there)


def test_keys_without_enter(terminal):
    """Keys come one by one without Enter and without an echo; arrow and function keys are none of ours."""
    here, there = terminal
    with Keyboard(there) as keyboard:
        assert keyboard.pressed() == ""
        assert not termios.tcgetattr(there)[3] & (termios.ICANON | termios.ECHO)
        os.write(here, b"1\x1b[A\x1b[15~\x1bOPq")
        assert keyboard.pressed() == "1q"


@pytest.mark.parametrize("error", [None, KeyboardInterrupt, ValueError])
def test_terminal_as_it_was(terminal, error):
    """After the block the terminal is as before it, however the block ended."""
    before = termios.tcgetattr(terminal[1])
    try:
        with Keyboard(terminal[1]):
            assert termios.tcgetattr(terminal[1]) != before
            if error:
                raise error
    except (KeyboardInterrupt, ValueError):
        pass
    assert termios.tcgetattr(terminal[1]) == before


def test_no_terminal(tmp_path):
    """A file is no keyboard, and silent."""
    with (tmp_path / "keys").open("w+b") as file:
        file.write(b"q")
        file.seek(0)
        with Keyboard(file.fileno()) as keyboard:
            assert keyboard.pressed() == ""


def test_background(terminal, monkeypatch):
    """A process in the background leaves the terminal alone."""
    monkeypatch.setattr(os, "tcgetpgrp", lambda fd: os.getpgrp() + 1)
    before = termios.tcgetattr(terminal[1])
    with Keyboard(terminal[1]) as keyboard:
        assert termios.tcgetattr(terminal[1]) == before
        assert keyboard.pressed() == ""


def test_log_is_on_disk_at_once(tmp_path):
    """Every frame is in the .log as soon as it is written, a whole candump line each."""
    path = tmp_path / "a.log"
    with recording(path) as write:
        write(0, STROKES)
        assert path.read_text() == "(0.000000) vcan0 100#00000000 R\n"
        write(1_500_000_000, CanFrame(0x1ABCDEF0, b"\x01", True))
        assert path.read_text().splitlines()[1] == "(1.500000) vcan0 1ABCDEF0#01 R"


def test_log_survives_a_kill(tmp_path):
    """After kill -9 the log holds every frame that was written, and no half of one."""
    path = tmp_path / "a.log"
    code = (
        "import os, signal, sys; from pathlib import Path; from targets.ecu import Frame\n"
        "from bench.cli.monitor_record import recording\n"
        "with recording(Path(sys.argv[1])) as write:\n"
        "    for k in range(1000): write(k * 1000, Frame(k, bytes(8)))\n"
        "    os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    done = subprocess.run([sys.executable, "-c", code, path], check=False, timeout=120)
    assert done.returncode == -9
    text = path.read_text()
    assert text.endswith(" 3E7#0000000000000000 R\n")
    assert text.count("\n") == 1000
    assert [found.name for found in tmp_path.iterdir()] == ["a.log"]


@pytest.mark.parametrize("suffix", [".log", ".asc", ".blf", ".mf4"])
def test_recording_whatever_ends_it(tmp_path, suffix):
    """In every format what was heard is there after an error, too, and replaces the older file."""
    path = tmp_path / f"a{suffix}"
    path.write_text("older")

    def fail():
        with recording(path) as write:
            for k in range(300):
                write(k * 10 * MS, CanFrame(0x100, bytes([k % 256, 0, 0, k % 16])))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fail()
    assert [found.name for found in tmp_path.iterdir()] == [path.name]
    assert len(read_lap(path).t_ns) > 250


def test_disk_is_full(tmp_path):
    """A disk that takes half a line takes none of it: the log ends with the last whole one, in one error."""
    path = tmp_path / "a.log"
    code = (
        "import resource, signal, sys; from pathlib import Path; from targets.ecu import Frame\n"
        "from bench.cli.monitor_record import recording; import can\n"
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (100, 100))\n"
        "from bench.errors import RecordError\n"
        "try:\n"
        "    with recording(Path(sys.argv[1])) as write:\n"
        "        for k in range(10): write(k, Frame(0x100, bytes(4)))\n"
        "except RecordError as error: print(error)\n"
    )
    command = [sys.executable, "-B", "-c", code, path]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120)
    assert done.stdout == f"{path}: cannot be written: no space left on device\n"
    assert path.read_text() == "(0.000000) vcan0 100#00000000 R\n" * 3


def test_recording_refused(tmp_path):
    """A folder, and a format nobody knows, are refused as the recorder does."""
    for path, says in ((tmp_path, "unknown suffix"), (tmp_path / "no" / "a.log", "no folder")):
        with pytest.raises(RecordError, match=says), recording(path):
            pass


def test_default_keys():
    """Keys 1 to 9 fire faults that a replay takes."""
    assert list(key_faults([])) == list("123456789")
    for spec in DEFAULTS.values():
        parse_command(spec)


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (["rear_stroke:open"], "not written KEY=SPEC"),
        (["oo=rear_stroke:open"], "not written KEY=SPEC"),
        (["\x1b=rear_stroke:open"], "not written KEY=SPEC"),
        (["q=rear_stroke:open"], "'q' means quit"),
        (["o=rear_stroke:open", "o=rear_stroke:hold"], "'o' fires rear_stroke:open already"),
        (["o=rear_stroke:melt"], "unknown kind 'melt'"),
        (["o=rear_stroke:open@5"], "fires @now"),
    ],
)
def test_keys_refused(given, says):
    """A key that is none, is taken, or fires what is no fault is refused."""
    with pytest.raises(FaultError, match=says):
        key_faults(given)


def drained(link, number):
    """The first `number` answers of the link."""
    found = []
    while len(found) < number:
        found += link.turn()
    return found


def test_link_asks_in_order():
    """Requests are asked one after the other; the instant of an answer lies between question and answer."""
    ticks = count(0, 10)
    asked = []

    def reply(path, line, patience):
        asked.append(line)
        return b'{"t_s": 1, "faults": []}' if b"fire" in line else b'{"error": "fault: no"}'

    link = FaultLink(Path("a"), lambda: next(ticks), reply)
    link.request("fire", "rear_stroke:open")
    link.request("clear")
    answers = [answer for answer in drained(link, 3) if answer.request["do"] != "list"]
    assert [answer.request["do"] for answer in answers] == ["fire", "clear"]
    assert answers[0].reply == {"t_s": 1, "faults": []}
    assert answers[1].error == "fault: no"
    assert asked[0] == b'{"do": "fire", "fault": "rear_stroke:open"}'


@pytest.mark.parametrize("reply", [b"\xff", b"[1]", b"{", b"7"])
def test_link_to_nonsense(reply):
    """A reply that is none is an error's text, never an exception."""
    link = FaultLink(Path("a"), lambda: 0, lambda path, line, patience: reply)
    assert drained(link, 1)[0].error


def test_link_over_the_socket(tmp_path):
    """Through the replay's own socket requests arrive and answers come back; without one it says so."""
    path = tmp_path / "s.replay"
    link = FaultLink(path, lambda: 0, ask)
    assert drained(link, 1)[0].error.startswith(f"no replay answers at {path}")
    done = threading.Event()

    def serve():
        with ControlSocket(path, lambda line, t_ns: b'{"t_s": 2, "faults": []}', 4096) as control:
            listening.set()
            while not done.is_set():
                control.turn(0)

    listening = threading.Event()
    server = threading.Thread(target=serve)
    server.start()
    try:
        assert listening.wait(60)
        link.request("fire", "rear_stroke:open")
        assert drained(link, 1)[0].reply == {"t_s": 2, "faults": []}
    finally:
        done.set()
        server.join()


class _Keys:
    def __init__(self):
        self.waiting = ""

    def pressed(self):
        keys, self.waiting = self.waiting, ""
        return keys


class _Link:
    def __init__(self):
        self.asked, self.answers = [], []

    def request(self, do, fault=None):
        self.asked.append((do, fault))

    def turn(self):
        answers, self.answers = self.answers, []
        return answers


class _Output:
    every_ns = REFRESH_NS

    def __init__(self):
        self.shown = []

    def show(self, look, frame):
        self.shown.append((look, frame))


@pytest.fixture
def session():
    """A session whose parts the test works by hand; drawing takes no time."""
    made = Session(Monitor(Codec()), _Keys(), _Link(), _Output(), Frame("a", {"1": "rear_stroke:open"}), None)
    made.now = 0
    made.clock = lambda: made.now
    return made


def test_refresh(session):
    """The screen is drawn at most ten times a second."""
    for now in range(0, 1000 * MS, 10 * MS):
        session.now = now
        assert session.turn(now, 0)
    assert len(session.output.shown) == 10


def test_drawing_takes_a_tenth(session):
    """A terminal that takes long to draw is drawn the less often."""
    session.output.show = lambda look, frame: (
        session.output.shown.append(look),
        setattr(session, "now", session.now + 50 * MS),
    )
    while session.now < 2_000 * MS:
        session.turn(session.now, 0)
        session.now += MS
    assert len(session.output.shown) == 4


def test_frames_before_the_screen(session):
    """While frames wait to be read the screen waits, two seconds at most."""
    session.turn(0, 0)
    for now in range(MS, 2 * BEHIND_REFRESH_NS, 50 * MS):
        session.now = now
        session.turn(now, BEHIND_NS)
    assert [look.t_ns // (1000 * MS) for look, _ in session.output.shown] == [0, 2]


def test_keys(session):
    """q quits, space holds the screen while all goes on, c clears, a fault's key fires, others do nothing."""
    session.keyboard.waiting = "1cx"
    assert session.turn(0, 0)
    assert session.link.asked == [("fire", "rear_stroke:open"), ("clear", None)]
    session.keyboard.waiting = " "
    session.monitor.heard(50 * MS, STROKES)
    assert session.turn(200 * MS, 0)
    held = session.output.shown[-1]
    assert (held[0].frames, held[1].paused) == (0, True)
    session.keyboard.waiting = " "
    session.turn(210 * MS, 0)
    shown = session.output.shown[-1]
    assert (shown[0].frames, shown[1].paused) == (1, False)
    session.keyboard.waiting = "q1"
    assert not session.turn(300 * MS, 0)
    assert len(session.link.asked) == 2


def test_answers(session):
    """What came of a key is noted; what the replay tells of its faults is known to the monitor."""
    row = {"number": 0, "spec": "rear_stroke:open@1", "state": "fired"}
    fire, listing = {"do": "fire", "fault": "rear_stroke:open"}, {"do": "list", "fault": None}
    session.link.answers = [Answer(5 * MS, fire, {"t_s": 1.0, "faults": [row]}, None)]
    session.turn(0, 0)
    assert session.output.shown[-1][1].note == "fired rear_stroke:open"
    assert session.output.shown[-1][0].faults[0].state == "fired"
    session.link.answers = [Answer(6 * MS, fire, None, "fault: too late"), Answer(7 * MS, listing, None, "x")]
    session.turn(200 * MS, 0)
    assert session.output.shown[-1][1].note == "fault: too late"
    assert session.output.shown[-1][0].faults == ()


class _Bus:
    """Gives what it is given, one thing a call, 1 ms each; then it is quiet."""

    def __init__(self, *things):
        self.things, self.now = list(things), 0

    def receive(self, timeout_s):
        self.now += MS if self.things else round(timeout_s * 1e9)
        thing = self.things.pop(0) if self.things else None
        if isinstance(thing, Exception):
            raise thing
        return thing


def test_every_frame_is_written():
    """Frames are written with the instant they arrived, in order, even those read late, until time is up."""
    bus = _Bus(*(Heard(STROKES, age) for age in (0, 0, 2 * MS, 0)))
    monitor, rows, turns = Monitor(Codec()), [], []
    listen(
        bus,
        monitor,
        lambda *row: rows.append(row),
        lambda *turn: turns.append(turn) or True,
        lambda: bus.now,
        0.2,
    )
    assert [t_ns // MS for t_ns, _ in rows] == [1, 2, 2, 4]
    assert monitor.frames == 4
    assert turns[0] == (MS, 0)
    assert len(turns) < 7
    assert bus.now >= 200 * MS


def test_quit_ends_it():
    """A turn that says so ends the listening."""
    bus = _Bus()
    listen(bus, Monitor(Codec()), None, lambda now, lag: now < 150 * MS, lambda: bus.now)
    assert bus.now == 150 * MS


def test_bus_goes_away():
    """A bus that goes away is the caller's to report, after what it still had to give has been written."""
    gone = BusError("network is down")
    bus = _Bus(Heard(STROKES, 0), gone, Heard(STROKES, 0), Heard(STROKES, 0), None, Heard(STROKES, 0))
    rows = []
    with pytest.raises(BusError, match="network is down"):
        listen(bus, Monitor(Codec()), lambda *row: rows.append(row), lambda *_: True, lambda: bus.now)
    assert len(rows) == 3
    with pytest.raises(BusError, match="first"):
        listen(_Bus(BusError("first"), gone), Monitor(Codec()), None, lambda *_: True, lambda: 0)
