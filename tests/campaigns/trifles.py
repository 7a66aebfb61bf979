"""A campaign of trifles, quick and deterministic; as a script, a run of it in a process of its own.

    python trifles.py STORE LOG WORKERS COUNT [WORK]

LOG gets a line "ID PID" as each trial begins. It ends with 2 and one line if refused, with 130 after Ctrl-C.
"""

import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from functools import partial
from hashlib import sha256
from pathlib import Path

from bench.errors import BenchError
from campaigns.runner import Local, run
from campaigns.store import Store, trial_id

CAMPAIGN = {"name": "trifles", "plan": {"rounds": 5_000}}


@dataclass(frozen=True)
class Trifle:
    """The n-th of them."""

    n: int

    def document(self):
        return {"kind": "trifle", "n": self.n}

    @property
    def id(self):
        return trial_id(self.document())


def quick(trifle):
    """Every third has no freeze frame."""
    digest = sha256(str(trifle.n).encode()).digest()
    frame = {"measured_mm": [byte / 7 for byte in digest]} if trifle.n % 3 else None
    return {"outcome": "MD" if digest[0] < 40 else "CD", "td_ns": digest[1], "group": trifle.n % 4}, frame


def steady(trifle):
    """Some 10 to 20 ms of work."""
    digest = b""
    for _ in range(15_000 + 5_000 * (trifle.n % 4)):
        digest = sha256(digest).digest()
    return quick(trifle)


def endless(trifle):
    """Sleeps or works, for a minute."""
    end_s = time.monotonic() + 60
    while time.monotonic() < end_s:
        time.sleep(60 * (trifle.n % 2))
    return quick(trifle)


def logged(trifle, work, log):
    """The same, and a line about it."""
    file = os.open(log, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
    os.write(file, f"{trifle.id} {os.getpid()}\n".encode())
    os.close(file)
    return work(trifle)


def trifles(count):
    return [Trifle(n) for n in range(count)]


def table(store):
    """How often each outcome came in each group, and the mean time: what a report would print."""
    lines = []
    rows = list(store.rows())
    for group in sorted({row.result["group"] for row in rows}):
        results = [row.result for row in rows if row.result["group"] == group]
        hits = sum(result["outcome"] == "CD" for result in results)
        mean = sum(result["td_ns"] for result in results) / len(results)
        lines.append(f"{group} | {hits} of {len(results)} | {mean:.3f}")
    return "\n".join(lines)


def start(store, log, workers, count, work="steady"):
    """The script, in a process group of its own, as a terminal starts it."""
    words = [sys.executable, __file__, *map(str, (store, log, workers, count)), work]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    return subprocess.Popen(words, **pipes, text=True, start_new_session=True)


def begun(log):
    """(id, pid) of every trial that was begun."""
    lines = log.read_text().splitlines() if log.exists() else []
    return [(line.split()[0], int(line.split()[1])) for line in lines]


def main(store, log, workers, count, work):
    signal.signal(signal.SIGINT, signal.default_int_handler)
    known = {"quick": quick, "steady": steady, "endless": endless}
    try:
        with Store.open(Path(store), CAMPAIGN) as kept:
            run(trifles(int(count)), partial(logged, work=known[work], log=log), kept, Local(int(workers)))
    except BenchError as error:
        print(error, file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
