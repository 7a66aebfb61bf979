"""The live bench end to end: replay, emulated ECU, monitor and candump as processes of their own.

python -m tests.benchmarks.live BUS [--seconds S] [--rate HZ] [--on mcu|host] [--late-limit MS]
    [--threshold X] [--json OUT]

BUS: socketcan:vcan0, strokebench:NAME, ... Counts what each one saw of what was sent, sets the verdict beside
that of virtual time, and, on SocketCAN, lets `canplayer` replay the recording beside it: both are judged by
the instants in candump's log, as distances from the plan, the least late frame taken as on time.

--threshold: the detector's, in place of the shipped calibration's. Its network is one of 100 Hz; at 1 kHz its
residual is past 0.1 without a fault, and only with a higher threshold is there a time to detect to compare.
"""

import argparse
import json
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from targets.calibration import dumps, load
from targets.ecus import DEFAULT_CALIBRATION

FAULT = "rear_stroke:open@{at}"
LOGGED = ("100", "101", "102")
MARGIN_S = 400
"""For a process to start: a user-mode kernel takes minutes."""
VERDICT = ("outcome", "t_alarm_s", "td_s", "reason")
QUANTILES = (("p50", 50), ("p99", 99), ("max", 100))
LINE = re.compile(r"\((\d+\.\d+)\) \S+ ([0-9A-F]+)#([0-9A-F]*)")


def bench(*words: object, **options: Any) -> subprocess.Popen:
    """`bench WORD...` in a process of its own."""
    command = [sys.executable, "-m", "bench.cli.main", *map(str, words)]
    return subprocess.Popen(command, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE, **options)


def done(process: subprocess.Popen, seconds: float = 600) -> tuple[int, str, str]:
    """Its exit code and what it said."""
    out, err = process.communicate(timeout=seconds)
    return process.returncode, out, err


def stopped(process: subprocess.Popen) -> tuple[int, str, str]:
    """As `done`, after Ctrl-C."""
    process.send_signal(signal.SIGINT)
    return done(process)


def frames(path: Path) -> list[tuple[float, str, str]]:
    """(instant in s, identifier, data) of a candump log."""
    return [(float(t), i, d) for t, i, d in LINE.findall(path.read_text())]


def percentiles(late_s: np.ndarray) -> dict[str, float]:
    """Of lateness, ms."""
    return {
        name: float(np.percentile(late_s, q)) * 1e3 for name, q in (("p50", 50), ("p99", 99), ("max", 100))
    }


def lateness(seen: list[tuple[float, str, str]], plan_s: np.ndarray) -> dict[str, float]:
    """How far behind the plan the logger's frames were seen; the least late one as on time."""
    late = np.array([t for t, i, _ in seen if i in LOGGED]) - plan_s[: sum(i in LOGGED for _, i, _ in seen)]
    return percentiles(late - late.min())


def dump(folder: Path, name: str, channel: str) -> tuple[subprocess.Popen, Path] | None:
    """candump on a SocketCAN channel, where there is one."""
    if shutil.which("candump") is None:
        return None
    path = folder / name
    with path.open("w") as out:
        return subprocess.Popen(["candump", "-L", channel], stdout=out), path


def measure(
    bus: str, seconds: float, rate: int, on: str, limit_ms: float, threshold: float | None, folder: Path
) -> dict[str, Any]:
    """One run of everything; what came of it."""
    interface, _, channel = bus.partition(":")
    calibration, model = load(DEFAULT_CALIBRATION), folder / "model.json"
    threshold = calibration.detector.threshold if threshold is None else threshold
    model.write_text(dumps(calibration.with_detector(threshold=threshold)))
    lap, fault = folder / "lap.csv", FAULT.format(at=seconds * 0.75)
    shared = ("--rate", rate, "--bitrate", 1_000_000, "--fault", fault)
    if not lap.exists():
        code, _, err = done(bench("lap", "generate", lap, "--seed", 7, "--seconds", seconds))
        assert code == 0, err
    virtual = folder / "virtual.json"
    done(bench("run", lap, "--on", on, "--model", model, *shared, "--json", virtual))

    monitor = bench("monitor", "--bus", bus, "--bitrate", 1_000_000, "--record", folder / "monitor.log",
                    "--json", folder / "monitor.json", stdin=subprocess.DEVNULL)  # fmt: skip
    dumped = dump(folder, "candump.log", channel) if interface == "socketcan" else None
    ecu = bench("ecu", "ifd", "--bus", bus, "--bitrate", 1_000_000, "--on", on, "--model", model)
    assert ecu.stderr is not None
    ready = ecu.stderr.readline()
    assert "Ctrl-C ends it" in ready, ready
    time.sleep(1)
    out = ("--late-limit", limit_ms, "--json", folder / "replay.json")
    replay = bench("replay", lap, "--bus", bus, "--ecu", "ifd", *shared, *out)
    code, said, err = done(replay, seconds * 2 + MARGIN_S)
    assert (folder / "replay.json").exists(), err + said
    time.sleep(0.5)
    fared, watched = stopped(ecu), stopped(monitor)
    live, alone = (json.loads((folder / f"{name}.json").read_text()) for name in ("replay", "virtual"))
    sent, heard = live["frames_sent"], live["frames_heard"]
    recorded = frames(folder / "monitor.log")
    result = {
        "bus": bus,
        "rate_hz": rate,
        "threshold": threshold,
        "sent": sent,
        "answers": heard,
        "unsent": live["frames_unsent"],
        "monitor": len(recorded),
        "late_ms": live["late_ms"] | {"max": live["late_ms"]["worst"]},
        "live": {name: live[name] for name in (*VERDICT, "td_late_ms")},
        "virtual": {name: alone[name] for name in VERDICT},
        "ecu": fared[2].strip(),
        "monitor_said": watched[1].strip().splitlines()[-6:],
    }
    if dumped:
        dumped[0].terminate()
        dumped[0].wait()
        result |= beside(folder, channel, dumped[1], 1 / rate)
    return result


def beside(folder: Path, channel: str, log: Path, period_s: float) -> dict[str, Any]:
    """What candump saw, and canplayer with the same frames."""
    seen = frames(log)
    ours = [row for row in seen if row[1] in LOGGED]
    plan_s = np.arange(len(ours)) // len(LOGGED) * period_s
    result: dict[str, Any] = {"candump": len(seen), "seen_late_ms": lateness(seen, plan_s)}
    if shutil.which("canplayer") is None:
        return result
    script = folder / "plan.log"
    script.write_text(
        "".join(f"({1000 + t:.6f}) {channel} {i}#{d}\n" for t, (_, i, d) in zip(plan_s, ours, strict=True))
    )
    started = dump(folder, "canplayer.log", channel)
    assert started
    time.sleep(0.5)
    # -g 1: it looks every millisecond whether a frame is due, the finest it can
    subprocess.run(["canplayer", "-g", "1", "-I", str(script)], check=True)
    time.sleep(0.5)
    started[0].terminate()
    started[0].wait()
    played = frames(started[1])
    return result | {"canplayer": len(played), "canplayer_late_ms": lateness(played, plan_s)}


def table(results: list[dict[str, Any]]) -> Table:
    """A row each."""
    names = ("bus", "Hz", "sent", "answers", "monitor", "candump", "lost", "late p50 ms", "p99", "max",
             "canplayer p50", "p99", "max", "alarm live s", "virtual s")  # fmt: skip
    drawn = Table(*names, box=None)
    for r in results:
        seen = [r[who] for who in ("monitor", "candump") if who in r]
        lost = max(0, r["sent"] + r["answers"] - min(seen))
        ours, theirs = r.get("seen_late_ms", r["late_ms"]), r.get("canplayer_late_ms", {})
        cells = [r["bus"], r["rate_hz"], r["sent"], r["answers"], r["monitor"], r.get("candump", "-"), lost]
        late = [f"{ours[name]:.2f}" for name in ("p50", "p99", "max")]
        other = [f"{theirs[name]:.2f}" if theirs else "-" for name in ("p50", "p99", "max")]
        td = [f"{r[who]['outcome']} {r[who]['t_alarm_s'] or 0:.4f}" for who in ("live", "virtual")]
        drawn.add_row(*map(str, (*cells, *late, *other, *td)))
    return drawn


def main() -> None:
    """Measure what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("bus")
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--rate", type=int, nargs="+", default=[100, 1000])
    parser.add_argument("--on", default="mcu")
    parser.add_argument("--late-limit", type=float, default=10.0, help="of the replay, ms")
    parser.add_argument("--threshold", type=float, help="of the detector  [default: as shipped]")
    parser.add_argument("--json", type=Path)
    words = parser.parse_args()
    results = []
    for rate in words.rate:
        with tempfile.TemporaryDirectory() as folder:
            how = (words.on, words.late_limit, words.threshold)
            results.append(measure(words.bus, words.seconds, rate, *how, Path(folder)))
            print(json.dumps(results[-1], indent=1), file=sys.stderr)
    Console(width=200).print(table(results))
    if words.json:
        words.json.write_text(json.dumps(results, indent=1))


if __name__ == "__main__":
    main()
