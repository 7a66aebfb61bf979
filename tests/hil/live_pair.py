"""The live pair on vcan0, as a script: logger and ECU as two processes, first the IFD, then the soft sensor.

    python live_pair.py FOLDER [own]

FOLDER holds lap.csv and model.json; what the processes wrote comes to lie beside them, and what became of
each in report.json. own: vcan0 belongs to this run alone, and may be taken down at its end.
"""

import json
import signal
import subprocess
import sys
import threading
from pathlib import Path

from bench.bus.live import LiveBus
from bench.errors import BusError
from targets.host import library

BUS = "socketcan:vcan0"
FAULT = "rear_stroke:short@1.5"
PATIENCE_S = 150
ON = "host" if library() else "mcu"
"""A user-mode kernel is too slow for the emulator to answer every 10 ms; the emulated ECU lives on a bus in
tests/cli/test_live.py, without one."""


def bench(*words: str) -> subprocess.Popen:
    # -P: not what lies in the working directory, but the package that is tested
    command = [sys.executable, "-P", "-m", "bench.cli.main", *words]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def ended(process: subprocess.Popen) -> dict:
    """How it ended; one that does not end is killed."""
    try:
        out, err = process.communicate(timeout=PATIENCE_S)
    except subprocess.TimeoutExpired:
        process.kill()
        out, err = process.communicate()
    return {"code": process.returncode, "out": out, "err": err}


def absent() -> str:
    try:
        with LiveBus("socketcan:vcan99"):
            return "opened"
    except BusError as error:
        return str(error)


def main(folder: Path, own: bool) -> None:
    lap, model = str(folder / "lap.csv"), str(folder / "model.json")
    report: dict = {"own": own, "absent": absent()}
    for role, fault, stop in (
        ("ifd", ("--fault", FAULT), signal.SIGINT),
        ("soft_sensor", (), signal.SIGTERM),
    ):
        ecu = bench("ecu", role, "--bus", BUS, "--model", model, "--on", ON)
        assert ecu.stderr is not None
        impatience = threading.Timer(PATIENCE_S, ecu.kill)
        impatience.start()
        ready = ecu.stderr.readline()
        impatience.cancel()
        out = ("--json", str(folder / f"{role}.json"), "--record", str(folder / f"{role}.log"))
        replay = ended(bench("replay", lap, "--bus", BUS, "--ecu", role, *out, *fault))
        if own and role == "soft_sensor":
            subprocess.run(["ip", "link", "set", "vcan0", "down"], check=True)
        else:
            ecu.send_signal(stop)
        report[role] = {"ready": ready, "replay": replay, "ecu": ended(ecu)}
    (folder / "report.json").write_text(json.dumps(report, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]), "own" in sys.argv[2:])
