"""Two ECUs, a recorder and a logger on one live bus, each a process of its own, as a script.

    python live_rides.py FOLDER BUS [guest]

FOLDER holds lap.csv and model.json; what the processes wrote comes to lie beside them, and what became of
each in report.json. First the IFD is judged, then the soft sensor; both are there all the time.
guest: the bus is that of a user-mode kernel, which is slow: the IFD's ride alone, at a quarter of the pace.
At its end the interface is taken down.
"""

import json
import shutil
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

from bench.bus.live import LiveBus
from bench.cli.lean import lean_can
from bench.errors import BusError
from targets.ecus import ROLES
from targets.host import library

FAULT = "rear_stroke:short@1.5"
LIMIT = ("--late-limit", "100")
"""Virtual machines stand still for tens of milliseconds now and then."""
PATIENCE_S = 150
ON = "host" if library() else "mcu"
"""A user-mode kernel is too slow for the emulator to answer every 10 ms."""


def bench(*words: str) -> subprocess.Popen:
    """`bench WORD...` in a process of its own."""
    command = [sys.executable, "-m", "bench.cli.main", *words]
    return subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def ended(process: subprocess.Popen) -> dict:
    """How it ended; one that does not end is killed."""
    try:
        out, err = process.communicate(timeout=PATIENCE_S)
    except subprocess.TimeoutExpired:
        process.kill()
        out, err = process.communicate()
    return {"code": process.returncode, "out": out, "err": err}


def first_word(process: subprocess.Popen) -> str:
    """What it says when it is ready."""
    assert process.stderr is not None
    impatience = threading.Timer(PATIENCE_S, process.kill)
    impatience.start()
    said = process.stderr.readline()
    impatience.cancel()
    return said


def written(path: Path) -> bool:
    """Whether a file is there within PATIENCE_S."""
    for _ in range(PATIENCE_S * 10):
        if path.exists():
            return True
        time.sleep(0.1)
    return False


def dump(folder: Path, interface: str, channel: str) -> subprocess.Popen | None:
    """can-utils' own witness, where the bus is the kernel's and it is installed."""
    if interface != "socketcan" or shutil.which("candump") is None:
        return None
    with (folder / "candump.log").open("w") as out:
        return subprocess.Popen(["candump", "-L", channel], stdout=out)


def absent() -> str:
    """What is said of an interface that is not there."""
    try:
        with LiveBus("socketcan:vcan99"):
            return "opened"
    except BusError as error:
        return str(error)


def main(folder: Path, bus: str, guest: bool) -> None:
    """Ride, and write report.json."""
    lean_can()
    lap, model = str(folder / "lap.csv"), str(folder / "model.json")
    interface, _, channel = bus.partition(":")
    report: dict = {"absent": absent()}
    words = ("--bus", bus, "--model", model, "--on", ON)
    ecus = {role: bench("ecu", role, *words) for role in ROLES}
    monitor = bench("monitor", "--bus", bus, "--record", str(folder / "monitor.log"),
                    "--json", str(folder / "monitor.json"))  # fmt: skip
    ready = {role: first_word(ecu) for role, ecu in ecus.items()}
    written(folder / "monitor.log")
    dumped = dump(folder, interface, channel)
    time.sleep(0.5)
    replays = {}
    rides: dict[str, tuple[str, ...]] = {"ifd": ("--fault", FAULT), "soft_sensor": ()}
    if guest:
        rides = {"ifd": (*rides["ifd"], "--speed", "0.25")}
    for role, more in rides.items():
        out = ("--json", str(folder / f"{role}.json"), "--record", str(folder / f"{role}.log"))
        replays[role] = ended(bench("replay", lap, "--bus", bus, "--ecu", role, *LIMIT, *out, *more))
    time.sleep(0.5)
    if dumped:
        dumped.terminate()
        dumped.wait()
    ecus["ifd"].send_signal(signal.SIGINT)
    stopped = {"ifd": ended(ecus["ifd"])}
    if guest:
        subprocess.run(["ip", "link", "set", channel, "down"], check=True)
    else:
        ecus["soft_sensor"].send_signal(signal.SIGTERM)
        monitor.send_signal(signal.SIGINT)
    stopped["soft_sensor"] = ended(ecus["soft_sensor"])
    report |= {"ready": ready, "replay": replays, "ecu": stopped, "monitor": ended(monitor)}
    (folder / "report.json").write_text(json.dumps(report, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2], "guest" in sys.argv[3:])
