"""What a failing test leaves in --bench-artifacts: the last seconds on its bus, and its freeze frame."""

import re
from hashlib import sha256
from pathlib import Path

from bench.errors import RecordError
from bench.mdlog.events import noted
from bench.pytest_plugin.ride import Bench
from bench.recorder import record
from bench.whole import whole

RECORDED_S = 10.0
"""How much of the bus is written, up to the failure."""


def keep(folder: str | Path, nodeid: str, bench: Bench, frame: str) -> str:
    """Write `NAME.log` and `NAME.txt` to `folder`; the line that says where, or why not."""
    base = Path(folder) / _name(nodeid)
    begin_ns = bench.now_ns - round(RECORDED_S * 1e9)
    rows = noted(bench.rows, bench.script.now.insertions, bench.script.codec)
    try:
        try:
            base.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise RecordError(f"{folder}: cannot be made: {(error.strerror or str(error)).lower()}") from None
        record(Path(f"{base}.log"), [row for row in rows if begin_ns <= row[0] <= bench.now_ns])
        with whole(Path(f"{base}.txt")) as part:
            part.write_text(frame + "\n", encoding="utf-8")
    except RecordError as error:
        return f"{error.side}: {error}"
    return f"{base}.log and .txt"


def _name(nodeid: str) -> str:
    """A file's name for a test: readable, of bounded length, another for every test."""
    plain = re.sub(r"[^A-Za-z0-9_.-]+", "-", nodeid).strip("-.")[-120:]
    return f"{plain}-{sha256(nodeid.encode()).hexdigest()[:8]}"
