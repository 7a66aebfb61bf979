"""The live pair on vcan0, as a script: two ECUs and the logger as processes of their own.

    python live_pair.py FOLDER [own]

FOLDER holds lap.csv and model.json; what the processes wrote comes to lie beside them, and what became of
each in report.json. own: vcan0 belongs to this run alone, and may be taken down at its end.
"""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

BUS = "socketcan:vcan0"
FAULT = "rear_stroke:short@2"
PATIENCE_S = 90


def bench(*words: str) -> subprocess.Popen:
    command = [sys.executable, "-m", "bench.cli.main", *words]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def outcome(process: subprocess.Popen) -> dict:
    out, err = process.communicate(timeout=PATIENCE_S)
    return {"code": process.returncode, "out": out, "err": err}


def main(folder: Path, own: bool) -> None:
    lap, model = str(folder / "lap.csv"), str(folder / "model.json")
    report = {}
    for role, faulty, stop in (("ifd", ("--fault", FAULT), signal.SIGINT), ("soft_sensor", (), signal.SIGTERM)):
        ecu = bench("ecu", role, "--bus", BUS, "--model", model)
        report[f"ready {role}"] = ecu.stderr.readline()
        out = ("--json", str(folder / f"{role}.json"), "--record", str(folder / f"{role}.log"))
        report[f"replay {role}"] = outcome(bench("replay", lap, "--bus", BUS, "--ecu", role, *out, *faulty))
        if own and role == "soft_sensor":
            subprocess.run(["ip", "link", "set", "vcan0", "down"], check=True)
        else:
            ecu.send_signal(stop)
        report[role] = outcome(ecu)
    (folder / "report.json").write_text(json.dumps(report, indent=1))


if __name__ == "__main__":
    main(Path(sys.argv[1]), "own" in sys.argv[2:])
