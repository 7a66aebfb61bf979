"""Logger, two ECUs and recorders as processes: on a real SocketCAN interface, and on a hub without one.

The interface is the kernel's own, or one of a kernel brought up for it.
"""

import json
import os
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

import pytest

from bench.faults.spec import parse_fault
from bench.laps.files import write_lap
from bench.run import run_lap
from bench.sensors.datasheets import load_sensors
from targets.calibration import dumps
from targets.ecus import ROLES, build
from targets.host import library
from tests.conftest import wavy_lap

HERE = Path(__file__).parent
WITH_VCAN = HERE.parents[2] / "shared" / "tools" / "with-vcan"
FLAGS = Path("/sys/class/net/vcan0/flags")
FAULT = "rear_stroke:short@1.5"
STATUS = {"ifd": 0x200, "soft_sensor": 0x210}
CHANNEL = "rides"
SECONDS = 2.5

BUSY = 0.3
"""Where processes wait for a processor for this share of the time, a run that was late proves nothing."""


def launcher() -> list[str]:
    """The words that bring a command to a vcan0 of its own; none where the kernel has one."""
    if FLAGS.exists() and int(FLAGS.read_text(), 16) & 1:
        return []
    if not WITH_VCAN.exists():
        pytest.skip("no vcan0: ip link add dev vcan0 type vcan && ip link set up vcan0, as root")
    if shutil.which("linux.uml") is None:
        pytest.skip("no vcan0 here, and no linux.uml to have one in: apt-get install user-mode-linux")
    return ["timeout", "--kill-after=10", "500", *punctual(), str(WITH_VCAN)]


def came_up(done: subprocess.CompletedProcess[str]) -> None:
    """Skip where the user-mode kernel could not be brought up."""
    if done.returncode in (125, 126):
        pytest.skip(f"with-vcan: {done.stderr.strip()[-200:]}")


def punctual() -> list[str]:
    """The words that give a command precedence over this machine's other work, where that is allowed."""
    words = ["chrt", "--rr", "1"]
    if (
        shutil.which("chrt")
        and subprocess.run([*words, "true"], capture_output=True, check=False).returncode == 0
    ):
        return words
    return []


def waited_s() -> float:
    """For how long some process of this machine has waited for a processor since it was started, s."""
    try:
        some = Path("/proc/pressure/cpu").read_text().splitlines()[0]
    except OSError:
        return 0.0
    return int(some.rpartition("=")[2]) / 1e6


class Ridden(NamedTuple):
    """A finished scenario: its folder, each role's status payloads in virtual time, how long work waited.

    guest: whether vcan0 was in a user-mode kernel. bus: which one it was.
    """

    folder: Path
    virtual: dict[str, list[str]]
    waited: float
    guest: bool
    bus: str

    def result(self, role):
        """The replay's document; skips if it proves nothing, and other work is to blame."""
        result = json.loads((self.folder / f"{role}.json").read_text())
        if result["outcome"] == "INVALID" and self.waited > BUSY:
            pytest.skip(
                f"no real time here: work waited for a processor {100 * self.waited:.0f} % of the time"
            )
        return result

    def heard(self, role, ride="ifd"):
        """The status payloads of one ECU in the recording of a replay."""
        return re.findall(rf" {STATUS[role]:03X}#(\S+)", (self.folder / f"{ride}.log").read_text())


def on_vcan():
    """The words that bring a command to vcan0, and the bus there."""
    return launcher(), "socketcan:vcan0"


def on_hub():
    """As `on_vcan`, on a bus of this user's own."""
    return [], "strokebench:rides"


VCAN = pytest.param(on_vcan, marks=pytest.mark.vcan)
ON_VCAN = pytest.mark.parametrize("ridden", [VCAN], indirect=True)
ON_HUB = pytest.mark.parametrize("ridden", [on_hub], indirect=True)


@pytest.fixture(scope="module", params=[VCAN, on_hub])
def ridden(request, tmp_path_factory, calibration):
    words, bus = request.param()
    folder = tmp_path_factory.mktemp("live")
    lap = wavy_lap(SECONDS)
    write_lap(lap, folder / "lap.csv")
    quiet = calibration.with_detector(threshold=20.0, multiple=2, warmup=100)
    (folder / "model.json").write_text(dumps(quiet))
    # First in virtual time: this also compiles what the processes would otherwise compile while they wait.
    virtual = {}
    for role in ROLES:
        ecu = build(role, calibration=folder / "model.json").power_on()
        done = run_lap(lap, ecu, [parse_fault(FAULT)], sensors=load_sensors("datasheet"))
        virtual[role] = [d.frame.data.hex().upper() for d in done.ride.frames if d.frame.id == STATUS[role]]
    guest = ["guest"] if words else []
    command = [*words, sys.executable, str(HERE / "live_rides.py"), str(folder), bus, *guest]
    environment = {**os.environ, "WITH_VCAN_MEM": "1G"}
    begun, waited = time.monotonic(), waited_s()
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    share = (waited_s() - waited) / (time.monotonic() - begun)
    if words:
        came_up(done)
    assert done.returncode == 0, done.stderr
    return Ridden(folder, virtual, share, bool(words), bus)


@pytest.fixture(scope="module")
def report(ridden):
    return json.loads((ridden.folder / "report.json").read_text())


EACH = pytest.mark.parametrize("role", ROLES)


def test_verdict(ridden, report):
    """Every cycle is answered in time by both ECUs, and the IFD finds the fault."""
    result = ridden.result("ifd")
    assert (result["outcome"], report["replay"]["ifd"]["code"]) == ("CD", 0), result
    assert (result["answers"], result["frames_heard"]) == (100 * SECONDS, 400 * SECONDS)
    assert report["replay"]["ifd"]["err"] == ""


@ON_HUB
def test_other_ecu(ridden, report):
    """On the same bus the other ECU is judged next."""
    result = ridden.result("soft_sensor")
    assert (result["outcome"], report["replay"]["soft_sensor"]["code"]) == ("OK", 0), result
    assert (result["answers"], result["frames_heard"]) == (100 * SECONDS, 400 * SECONDS)


@EACH
def test_status_frames_of_the_virtual_run(ridden, report, role):
    """What each of two ECUs says in wall time is what it says in virtual time, byte for byte and in order."""
    ridden.result("ifd")
    assert ridden.heard(role) == ridden.virtual[role]


def test_nothing_is_lost(ridden, report):
    """The monitor's recording, and candump's, hold every frame that was sent, and nothing else."""
    rides = [ridden.result(role) for role in report["replay"]]
    recorded = (ridden.folder / "monitor.log").read_text().splitlines()
    assert len(recorded) == sum(ride["frames_sent"] + ride["frames_heard"] for ride in rides)
    dumped = ridden.folder / "candump.log"
    if dumped.exists():
        frames = [
            [line.split()[2] for line in lines] for lines in (dumped.read_text().splitlines(), recorded)
        ]
        assert frames[0] == frames[1]


def test_lateness_is_reported(ridden, report):
    """The replay says how late it was, on the screen and in its document."""
    late = ridden.result("ifd")["late_ms"]
    assert 0 < late["mean"] <= late["worst"]
    said = report["replay"]["ifd"]["out"]
    assert f"{late['p99']:.3f} ms (p99), {late['worst']:.3f} ms at worst" in said


def test_time_to_detect(ridden, report):
    """The live time to detect is the virtual one, but for the wall's own delays, which are told."""
    result = ridden.result("ifd")
    assert result["t_active_s"] == 1.5
    assert result["td_s"] == pytest.approx(0.391, abs=0.01 + result["td_late_ms"] / 1e3)
    assert 0 <= result["td_late_ms"] <= result["late_ms"]["worst"]


@EACH
def test_ecu_says_when_it_is_ready(ridden, report, role):
    """The ECU's first line says on which bus it lives, and where it runs."""
    on = "host" if library() else "mcu"
    assert report["ready"][role] == f"ecu {role} on {ridden.bus}, running on {on}; Ctrl-C ends it\n"


def test_signals_end_the_ecu(ridden, report):
    """SIGINT, and SIGTERM where the bus stays up, end the ECU with exit code 0 and how it fared."""
    for role in ["ifd"] if ridden.guest else ROLES:
        ecu = report["ecu"][role]
        assert (ecu["code"], ecu["out"]) == (0, "")
        assert re.match(r"\d+ frames sent in [\d.]+ s; behind the clock by [\d.]+ ms at worst\n", ecu["err"])


@ON_VCAN
def test_bus_taken_down(ridden, report):
    """An interface taken down under an ECU and a monitor is one line and exit code 2 for each."""
    if not ridden.guest:
        pytest.skip("vcan0 is not this test's to take down")
    for fared in (report["ecu"]["soft_sensor"], report["monitor"]):
        assert fared["code"] == 2
        assert re.fullmatch(
            r"bench: bus: socketcan:vcan0: cannot receive: .*[Nn]etwork is down.*",
            fared["err"].splitlines()[-1],
        )


@ON_VCAN
def test_interface_that_does_not_exist(ridden, report):
    """Where the kernel has CAN, an interface it does not have is one line."""
    assert re.fullmatch(r"socketcan:vcan99: cannot be opened: .*No such device.*", report["absent"])
