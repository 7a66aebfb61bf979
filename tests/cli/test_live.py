"""`bench replay` and `bench ecu` from the command line: what they print, write, refuse, and how they end."""

import json
import os
import signal
import threading

import pytest

from bench.bus.live import LiveBus
from bench.errors import BusError
from bench.laps.files import write_lap
from bench.serve import rehearse, serve
from targets.ecus import build
from targets.host import library
from tests.conftest import wavy_lap

SIGNALS = pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=["INT", "TERM"])

ON = "host" if library() else "mcu"


def stops(monkeypatch, method, number, after=3):
    """Let `number` reach this process when the bus is used for the `after`th time."""
    plain, calls = getattr(LiveBus, method), []

    def used(self, *words):
        calls.append(words)
        if len(calls) == after:
            os.kill(os.getpid(), number)
        return plain(self, *words)

    monkeypatch.setattr(LiveBus, method, used)


@pytest.fixture
def short(tmp_path):
    """A lap of thirty cycles."""
    write_lap(wavy_lap(0.3), tmp_path / "short.csv")
    return tmp_path / "short.csv"


@pytest.fixture
def out(tmp_path):
    """Where the result is to go."""
    return tmp_path / "out.json"


def test_replay_without_an_ecu(bench, short, out, tmp_path):
    """A replay says what it sent and how late it was, on the screen and as JSON, and records what it saw."""
    said = bench("replay", short, "--bus", "virtual:cli", "--json", out, "--record", tmp_path / "out.log")
    assert said.out.startswith("90 frames sent, 0 heard, 0 unsent (queue full 0 times); bus ")
    assert "\nlate by " in said.out
    result = json.loads(out.read_text())
    assert (result["frames_sent"], result["frames_heard"]) == (90, 0)
    assert 0 <= result["late_ms"]["mean"] <= result["late_ms"]["worst"]
    assert said.code == (0 if result["late_ms"]["worst"] < 10 else 1)
    assert len((tmp_path / "out.log").read_text().splitlines()) == 90


def test_replay_without_an_answer(bench, short, out):
    """With --ecu and no ECU there the verdict is INVALID, in one line, and the exit code 1."""
    said = bench("replay", short, "--bus", "virtual:cli", "--ecu", "ifd", "--json", out)
    assert said.code == 1
    result = json.loads(out.read_text())
    assert (result["outcome"], result["answers"], result["td_s"]) == ("INVALID", 0, None)
    assert f"INVALID  {result['reason']}\n" in said.out


def test_replay_names_what_is_not_sent(bench, tmp_path):
    """Messages that the lap cannot fill are named with the channels they lack."""
    write_lap(wavy_lap(0.1, names=("fork_stroke_mm", "rear_stroke_mm")), tmp_path / "lap.csv")
    said = bench("replay", tmp_path / "lap.csv", "--bus", "virtual:cli")
    assert "not sent: MOTION, the lap lacks pitch_rate_dps, speed_kmh" in said.out


@SIGNALS
def test_replay_stopped(bench, short, out, tmp_path, monkeypatch, number):
    """A replay that is stopped says so in one line and exits with 130; the recording holds what was sent."""
    stops(monkeypatch, "send", number)
    said = bench("replay", short, "--bus", "virtual:cli", "--json", out, "--record", tmp_path / "out.log")
    assert said.code == 130
    assert said.err.startswith("bench: replay: stopped at 0.0")
    assert said.err.endswith(" s, before the lap's end; no verdict\n")
    assert not out.exists()
    assert len((tmp_path / "out.log").read_text().splitlines()) == 2


@SIGNALS
def test_ecu_stopped(bench, monkeypatch, number):
    """An ECU says when it is ready, and how it fared when Ctrl-C or SIGTERM ends it, with exit code 0."""
    stops(monkeypatch, "receive", number)
    said = bench("ecu", "ifd", "--bus", "virtual:cli", "--on", ON)
    assert (said.code, said.out) == (0, "")
    assert said.err.startswith(f"ecu ifd on virtual:cli, running on {ON}; Ctrl-C ends it\n0 frames sent in ")


def test_signals_are_as_before(bench):
    """After the command SIGTERM does what it did before."""
    before = signal.getsignal(signal.SIGTERM)
    bench("ecu", "ifd", "--bus", "virtual:cli", "--seconds", 0, "--on", ON)
    assert signal.getsignal(signal.SIGTERM) is before


def test_ecu_for_so_long(bench):
    """With --seconds the ECU ends by itself and says what it sent."""
    said = bench("ecu", "soft_sensor", "--bus", "virtual:cli", "--seconds", 0.05, "--on", ON)
    assert said.code == 0
    assert "\n0 frames sent in 0." in said.err


@pytest.mark.parametrize("command", ["replay", "ecu"])
def test_bus_goes_away(bench, short, tmp_path, monkeypatch, command):
    """A bus that goes away while it is used is one line and exit code 2; what was recorded is kept."""

    def gone(self, *_):
        raise BusError(f"{self.name}: cannot receive: network is down")

    monkeypatch.setattr(LiveBus, "receive", gone)
    words = (short, "--record", tmp_path / "out.log") if command == "replay" else ("ifd", "--on", ON)
    said = bench(command, *words, "--bus", "virtual:cli")
    assert said.code == 2
    assert command == "ecu" or len((tmp_path / "out.log").read_text().splitlines()) == 3
    assert said.err.splitlines()[-1] == "bench: bus: virtual:cli: cannot receive: network is down"


def test_pair_in_one_process(bench, short, out, model):
    """The command's logger and an ECU beside it on one bus: answered, with a document that says so."""
    made = build("ifd", ON, model())
    rehearse(made.power_on())
    ready = threading.Event()
    with LiveBus("virtual:both") as there:
        live = {"seconds": 1.0, "ready": ready.set}
        thread = threading.Thread(target=serve, args=(made.power_on(), there), kwargs=live)
        thread.start()
        assert ready.wait(60)
        said = bench("replay", short, "--bus", "virtual:both", "--ecu", "ifd", "--json", out)
        thread.join()
    result = json.loads(out.read_text())
    assert result["answers"] > 0
    # a machine with other work may be late; then the verdict says so
    assert result["outcome"] in ("OK", "INVALID")
    assert (said.code == 0) == (result["outcome"] == "OK")


@pytest.mark.parametrize("command", [("replay", "LAP"), ("ecu", "ifd")], ids=["replay", "ecu"])
@pytest.mark.parametrize(
    ("bus", "says"),
    [
        ("pigeon:1", "bus: pigeon:1: no interface 'pigeon'; python-can has "),
        ("socketcan:no99", "bus: socketcan:no99: cannot be opened: "),
        ("", "bus: : no interface ''"),
    ],
)
def test_bus_that_is_not_there(refused, short, command, bus, says):
    """An interface nobody knows, and one that does not exist here, are refused with their name."""
    assert says in refused(*(short if word == "LAP" else word for word in command), "--bus", bus)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("replay", "none.csv"), "lap: none.csv: no such file"),
        (("replay", "LAP", "--ecu", "abs"), "ecu: no ECU abs; there are ifd, soft_sensor"),
        (("replay", "LAP", "--record", "a.txt"), "record: a.txt: unknown suffix '.txt'"),
        (("replay", "LAP", "--json", "none/a.json"), "record: none/a.json: no folder none"),
        (("replay", "LAP", "--fault", "rear_stroke"), "fault: 'rear_stroke' has no @TIME"),
        (("ecu", "abs"), "ecu: no ECU abs; there are ifd, soft_sensor"),
        (("ecu", "ifd", "--on", "moon"), "ecu: no place moon to run an ECU"),
        (("ecu", "ifd", "--model", "none.json"), "calibration: none.json: no such file"),
        (("ecu", "ifd", "--elf", "none.elf"), "firmware: none.elf: no such file"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else "",
)
def test_refused_before_the_bus_is_opened(refused, short, monkeypatch, words, says):
    """What is wrong with the rest is refused before any bus is touched."""

    def opened(*_):
        raise AssertionError("the bus was opened")

    monkeypatch.setattr(LiveBus, "__init__", opened)
    assert says in refused(*(short if word == "LAP" else word for word in words), "--bus", "virtual:cli")
