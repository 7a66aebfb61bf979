"""The ground station's end: a pymavlink client over real UDP, and the options of `bench replay`."""

import json
import select
import socket
import struct
from collections import deque

import pytest

from bench.bus.live import Heard
from bench.cli.ground_link import GroundLink
from bench.codec import Codec
from bench.errors import MavlinkError
from bench.laps.files import write_lap
from bench.live import LiveRig
from bench.mavlink.injector import Injector
from bench.mavlink.link import MOST_A_TURN, Link, Rights
from bench.mavlink.telemetry import Telemetry
from bench.panel import Panel
from bench.plant.motorcycle import load_motorcycle
from bench.plant.ride import ride
from bench.plant.route import load_route
from bench.run import prepare, run_lap
from bench.watch import Watch
from campaigns.plan import load
from targets.ecus import calibration_of
from targets.emulated import EmulatedEcu
from tests.bench.mavlink.desk import (
    ACCEPTED,
    DENIED,
    DISTANCE,
    FAILED,
    IN_PROGRESS,
    MS,
    OFF,
    OK,
    STUCK,
    UNSUPPORTED,
    Station,
)
from tests.conftest import wavy_lap

CODEC = Codec()


class Ground(Station):
    """A ground station on a UDP socket of its own."""

    def __init__(self):
        super().__init__()
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(30)
        self.said = []

    @property
    def port(self):
        return self.socket.getsockname()[1]

    def send(self, packet, link):
        """Send, and wait until it lies at the link's door."""
        self.socket.sendto(packet, link.own)
        assert select.select([link], [], [], 30)[0]

    def hear(self):
        """What has come by now; a datagram on the loopback has come when `sendto` returns."""
        while select.select([self.socket], [], [], 0)[0]:
            self.said += self.read(self.socket.recv(2048))

    def close(self):
        self.socket.close()


@pytest.fixture
def ground():
    station = Ground()
    yield station
    station.close()


class EcuBus:
    """A bus with `ecu` on it, and a clock: waiting is what makes time pass."""

    echoes, refusal = False, ""

    def __init__(self, ecu):
        self.ecu, self.now, self.answers = ecu, 0, deque()

    def clock(self):
        return self.now

    def send(self, frame):
        self._run(self.now)
        self.ecu.receive(frame, self.now)
        return True

    def receive(self, timeout_s):
        until = self.now + max(1, round(timeout_s * 1e9))
        if not self.answers:
            self._run(until)
        if not self.answers:
            self.now = until
            return None
        self.now, frame = self.answers.popleft()
        return Heard(frame, 0)

    def _run(self, t_ns):
        while not self.answers and (request := self.ecu.advance(t_ns)) is not None:
            self.ecu.sent(request.handle, request.t_ns)
            self.answers.append((max(request.t_ns, self.now), request.frame))


class Pilot:
    """Works the ground station: `script` yields the bench time, ms, or the answers it waits for, to go on."""

    def __init__(self, ground, script):
        self.ground, self.script = ground, script
        self.waits = next(script)

    def turn(self, t_ns):
        self.ground.hear()
        while self.waits is not None and self.waits(t_ns):
            self.waits = next(self.script, None)


def at(t_ms):
    return lambda t_ns: t_ns >= t_ms * MS


def answers(ground):
    return [m.result for m in ground.said if m.get_type() == "COMMAND_ACK"]


def texts(ground):
    return [m.text for m in ground.said if m.get_type() == "STATUSTEXT"]


@pytest.fixture(scope="module")
def simulated():
    return ride(load_route("test_lap"), load_motorcycle(), 30_000, 9.0)


def test_ground_station_over_udp(simulated, image, ground):
    """It injects, sees the alarm, clears, sees the alarm taken back, and has every answer in order."""
    ecu = EmulatedEcu(image, calibration_of("gsxr1000_checks"))
    script, watch = prepare(simulated, (), (), "replay", CODEC), Watch(CODEC)
    panel = Panel(script)
    link = GroundLink(str(ground.port), Link(Telemetry(watch, panel), Injector(panel), Rights(True)))

    def work():
        yield at(5000)
        ground.send(ground.long(DISTANCE, OFF, 2), link)
        yield lambda _: answers(ground) == [IN_PROGRESS, ACCEPTED] and len(texts(ground)) == 1
        ground.send(ground.long(DISTANCE, 9, 2), link)
        ground.send(ground.long(DISTANCE, OK, 2), link)
        yield lambda _: len(answers(ground)) == 5 and len(texts(ground)) == 2

    pilot = Pilot(ground, work())
    bus = EcuBus(ecu)
    rig = LiveRig(script, bus, watch, clock=bus.clock, attend=[panel.settle, link.turn, pilot.turn])
    rig.finish()
    link.close()
    ground.hear()
    assert rig.failure is None
    assert pilot.waits is None
    assert answers(ground) == [IN_PROGRESS, ACCEPTED, UNSUPPORTED, IN_PROGRESS, ACCEPTED]
    alarm, fault = watch.alarms[0], script.now.insertions[0]
    td_s = (alarm.on_ns - fault.t_active_ns) / 1e9
    assert texts(ground)[0] == f"alarm open, TD {td_s:.3f} s"
    assert texts(ground)[1].startswith("alarm open taken back after ")
    names = {m.name for m in ground.said if m.get_type() == "NAMED_VALUE_FLOAT"}
    assert names == {"residual", "predicted", "step_cyc"}
    assert [m.get_type() for m in ground.said].count("HEARTBEAT") == 9
    again = run_lap(simulated, EmulatedEcu(image, calibration_of("gsxr1000_checks")), script.now.specs)
    assert [i.t_active_ns for i in again.insertions] == [fault.t_active_ns]
    assert again.verdict.outcome == "CD"


@pytest.fixture
def linked(ground):
    """Makes a link to `ground` with rights as given, of a lap that stands still."""
    script = prepare(wavy_lap(1.0), (), (), "replay", CODEC)
    panel = Panel(script)
    links = []

    def make(**rights):
        inner = Link(Telemetry(None, panel), Injector(panel), Rights(**rights))
        links.append(GroundLink(f"127.0.0.1:{ground.port}", inner))
        return links[-1]

    yield make
    for link in links:
        link.close()


@pytest.fixture
def idle(linked):
    """Such a link with the rights that there are without any option."""
    return linked()


def test_denied_without_leave(idle, ground):
    """Without --allow-inject a command is DENIED, and told so."""
    ground.send(ground.long(DISTANCE, OFF, 2), idle)
    idle.turn(100 * MS)
    ground.hear()
    assert answers(ground) == [DENIED]


def test_turn_never_reads_for_long(idle, ground):
    """Whatever has come, packets, rubbish or nothing at all, a turn takes so much and leaves the rest."""
    for _ in range(3 * MOST_A_TURN):
        ground.send(b"", idle)
    idle.turn(0)
    assert select.select([idle], [], [], 0)[0]
    for _ in range(3):
        idle.turn(0)
    assert not select.select([idle], [], [], 0)[0]


def test_nobody_listens(idle, ground):
    """A ground station that is gone is none of the replay's business."""
    ground.close()
    said = []
    plain = idle.link.turn
    idle.link.turn = lambda t_ns: said.append(plain(t_ns)) or said[-1]
    for k in range(5):
        idle.turn(k * 500 * MS)
    assert said[-1]  # it goes on saying what is due
    assert idle.fileno() >= 0


def test_the_last_is_said(linked, ground):
    """What has not been decided when the link is closed has failed, and the ground station hears of it."""
    link = linked(inject=True)
    # a sensor at its full scale cannot be stuck there: the second never acts
    for t_ms, kind in ((10, OFF), (20, STUCK)):
        ground.send(ground.long(DISTANCE, kind, 2), link)
        link.turn(t_ms * MS)
    link.close()
    ground.hear()
    assert answers(ground) == [IN_PROGRESS, ACCEPTED, IN_PROGRESS, FAILED]


@pytest.mark.parametrize("peer", ["", "x", "0", "65536", "127.0.0.1:", "127.0.0.1", ":-1", "1:2:x", "١٤"])
def test_no_port(peer):
    """A ground station without a usable port is refused with how one is written."""
    with pytest.raises(MavlinkError, match=r"has no port; a ground station is written \[HOST:\]PORT"):
        GroundLink(peer, None)


def test_no_such_host():
    """A host that is none is refused by its name."""
    with pytest.raises(MavlinkError, match=r"^no\.such\.host\.invalid:14550: "):
        GroundLink("no.such.host.invalid:14550", None)


# --- bench replay -------------------------------------------------------------------------------------------


@pytest.fixture
def short(tmp_path):
    folder = tmp_path / "laps"
    folder.mkdir()
    write_lap(wavy_lap(0.3), folder / "short.csv")
    return folder / "short.csv"


def test_replay(bench, short, ground, tmp_path):
    """A replay tells its ground station, keeps the .tlog, and puts what was asked into the JSON."""
    out, tlog = tmp_path / "out.json", tmp_path / "out.tlog"
    words = ("--mavlink", ground.port, "--tlog", tlog, "--json", out)
    said = bench("replay", short, "--bus", "virtual:ground", *words)
    ground.hear()
    kinds = [m.get_type() for m in ground.said]
    assert (kinds[0], kinds.count("HEARTBEAT")) == ("HEARTBEAT", 1)
    assert "mavlink: 0 failure commands carried out, 0 refused; packets refused: 0\n" in said.out
    assert json.loads(out.read_text())["mavlink"]["commands"] == []
    data, packets = tlog.read_bytes(), []
    while data:
        packets.append((struct.unpack_from(">Q", data)[0], data[8 : 20 + data[9]]))
        data = data[20 + data[9] :]
    assert len(packets) == len(kinds)
    assert packets == sorted(packets, key=lambda row: row[0])


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--allow-inject",), "--allow-inject needs --mavlink"),
        (("--inject-from", "127.0.0.1"), "--inject-from needs --mavlink"),
        (("--tlog", "x.tlog"), "--tlog needs --mavlink"),
        (("--mavlink", "14550", "--inject-from", "::1"), "--inject-from ::1 needs --allow-inject"),
        (("--mavlink", "garage"), "'garage' has no port"),
        (("--mavlink", "1", "--allow-inject", "--inject-from", "x"), "'x' to inject from is no IP address"),
    ],
)
def test_options_that_mean_nothing(refused, short, words, says):
    """Options without what they need are refused before anything is sent."""
    assert f"mavlink: {says}" in refused("replay", short, "--bus", "virtual:ground", *words)


@pytest.mark.parametrize("option", ["--tlog", "--session"])
def test_files_that_cannot_be_written(refused, short, tmp_path, option):
    """A file that could not be written afterwards is refused beforehand."""
    words = ("--mavlink", 14550, option, tmp_path / "none" / "out")
    assert "no folder" in refused("replay", short, "--bus", "virtual:ground", *words)


def test_session(bench, short, tmp_path):
    """With --session the faults of the replay are a campaign file, whole, beside the other results."""
    session = tmp_path / "session.toml"
    words = ("--fault", "rear_stroke:open@0.1234+0.05", "--session", session)
    bench("replay", short, "--bus", "virtual:ground", *words)
    assert load(str(session)).faults == {"1 rear_stroke:open": "rear_stroke:open@0.1234+0.05"}
    assert [path.name for path in sorted(tmp_path.iterdir())] == ["laps", "session.toml"]
