"""The core under the sanitizers: built with its driver into one program, which runs as a process of its own.

Belongs here: building it, talking to it, and reading which of the core's lines it has run. Never: what it
is asked and what it should answer.
"""

import gzip
import json
import os
import shutil
import struct
import subprocess
import tempfile
from collections import deque
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from targets.calibration import ROOM, Calibration
from targets.ecu import Frame, Transmission
from targets.ecus import ROLES
from targets.firmware import HERE

TESTS = Path(__file__).parent
CORE = HERE / "core"
SOURCES = (*sorted(CORE.glob("*.c")), TESTS / "driver.c", TESTS / "decide.c")

WARNINGS = "all extra pedantic shadow conversion sign-conversion double-promotion cast-qual undef vla"
WARNINGS += " strict-prototypes missing-prototypes error"
STRICT = ("-std=c99", "-ffp-contract=off", f"-I{CORE}", *(f"-W{name}" for name in WARNINGS.split()))

SANITIZED = (
    "-O1",
    "-g",
    "-fsanitize=address,undefined,float-divide-by-zero,float-cast-overflow",
    "-fno-sanitize-recover=all",
)

COUNTED = ("-O0", "--coverage", "-fkeep-inline-functions", "-fkeep-static-functions")
"""Without the sanitizers, whose branches would count; a function that nothing calls is kept, and counts."""

FRAME = np.dtype([("id", "<u4"), ("length", "<u4"), ("data", "u1", 8)])
REPLY = np.dtype(
    [("due", "<u4"), ("predicted_mm", "<f4"), ("residual", "<f4"), ("status", FRAME), ("timing", FRAME)]
)
VERDICT = np.dtype([("residual", "<f4"), ("ready", "<u4"), ("alarm", "<u4"), ("kind", "<u4")])

HEAD_BYTES = 216
"""What the core reads of an image before it knows its size."""


class Found(AssertionError):
    """A sanitizer ended the process; the message is its report."""


@dataclass(frozen=True)
class Program:
    """The built driver, and the folder that holds the compiler's notes for gcov."""

    path: Path

    def start(self, counts: Path | None = None) -> "Core":
        """A process of it; line counts go into the folder `counts`, by default nowhere that is kept."""
        return Core(self.path, counts)


def build(folder: Path, *flags: str) -> Program:
    """Compile the core and its driver with all warnings as errors, and with `flags`.

    Raises AssertionError with what the compiler said.
    """
    compiler = shutil.which("gcc") or "gcc"
    command = [compiler, *STRICT, *flags, *map(str, SOURCES), "-o", str(folder / "driver")]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=folder)
    assert done.returncode == 0, done.stderr
    return Program(folder / "driver")


class Core:
    """A process of the driver. Raises Found, with the report, where a sanitizer ends it."""

    def __init__(self, program: Path, counts: Path | None = None) -> None:
        self._scratch = tempfile.TemporaryDirectory()
        # Paths below GCOV_PREFIX keep none of the build's folders: counts of two runs never mix.
        where = {"GCOV_PREFIX": str(counts or self._scratch.name), "GCOV_PREFIX_STRIP": "99"}
        self._errors = (Path(self._scratch.name) / "stderr").open("w+b")
        self._process = subprocess.Popen(
            [program],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            env={**os.environ, **where},
        )

    def init(self, image: bytes, role: str = "ifd", room: int | None = None) -> int:
        """Switch on with `image` in `room` bytes of flash, its own by default: the fault, 0 for none."""
        block = image.ljust(HEAD_BYTES, b"\xff")
        words = struct.pack("<3I", ROLES.index(role), len(block) if room is None else room, len(block))
        return int(np.frombuffer(self._ask(b"I" + words + block, 4), "<u4")[0])

    def frames(self, frames: NDArray[Any], cycles: int = 0) -> NDArray[Any]:
        """A REPLY for each FRAME; `cycles`: what the steps are said to have taken."""
        asked = b"F" + struct.pack("<2I", len(frames), cycles) + frames.tobytes()
        return np.frombuffer(self._ask(asked, len(frames) * REPLY.itemsize), REPLY)

    def overrun(self) -> None:
        """Tell the core that a cycle came too soon."""
        self._ask(b"O", 0)

    def decide(self, image: bytes, predicted: ArrayLike, measured: ArrayLike) -> NDArray[Any]:
        """The decision maker alone over a ride of strokes in mm: a VERDICT a sample."""
        p, m = np.asarray(predicted, "<f4"), np.asarray(measured, "<f4")
        words = struct.pack("<2I", len(p), len(image))
        asked = b"D" + words + image + p.tobytes() + m.tobytes()
        return np.frombuffer(self._ask(asked, len(p) * VERDICT.itemsize), VERDICT)

    def close(self) -> None:
        """Let the process end; it must end well, and say nothing."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        code = self._process.wait()
        report = self._report()
        if code or report:
            raise Found(report or f"the driver ended with {code}")

    def _ask(self, command: bytes, size: int) -> bytes:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        try:
            self._process.stdin.write(command)
            self._process.stdin.flush()
        except BrokenPipeError:
            raise Found(self._report()) from None
        answer = self._process.stdout.read(size)
        if len(answer) != size:
            self._process.wait()
            raise Found(self._report())
        return answer

    def _report(self) -> str:
        self._errors.seek(0)
        return self._errors.read().decode(errors="replace")


@dataclass
class SanitizedEcu:
    """An ECU whose core runs in a `Core`: the same promises as on any other host."""

    core: Core
    calibration: Calibration
    name: str = "ifd"
    _queue: deque[Transmission] = field(default_factory=deque)
    _handle: int = 0

    def __post_init__(self) -> None:
        assert self.core.init(self.calibration.image(), self.name, ROOM) == 0

    def advance(self, t_ns: int) -> Transmission | None:
        """The next frame that was requested at or before `t_ns`."""
        return self._queue.popleft() if self._queue and self._queue[0].t_ns <= t_ns else None

    def receive(self, frame: Frame, t_ns: int) -> None:
        """Take in a frame; a completed input cycle is answered at the same instant."""
        if frame.extended:
            return  # another identifier than the standard one of the same number
        asked = np.zeros(1, FRAME)
        asked["id"], asked["length"] = frame.id, len(frame.data)
        asked["data"][0, : len(frame.data)] = list(frame.data)
        reply = self.core.frames(asked)[0]
        for answer in (reply["status"], reply["timing"]) if reply["due"] else ():
            self._handle += 1
            sent = Frame(int(answer["id"]), answer["data"][: answer["length"]].tobytes())
            self._queue.append(Transmission(t_ns, self._handle, sent))

    def sent(self, handle: int, t_ns: int) -> None:
        """Nothing waits for a mailbox here."""

    def where(self) -> str:
        """A process that a sanitizer ended has said so already."""
        return ""


@dataclass
class Coverage:
    """How often each line of one source file ran, and each way (line, number) out of a branch was taken."""

    lines: dict[int, int] = field(default_factory=dict)
    branches: dict[tuple[int, int], int] = field(default_factory=dict)

    @property
    def lines_run(self) -> int:
        """How many lines ran."""
        return sum(times > 0 for times in self.lines.values())

    @property
    def branches_taken(self) -> int:
        """How many ways out of a branch were taken."""
        return sum(times > 0 for times in self.branches.values())

    def missed(self) -> list[int]:
        """The numbers of the lines that never ran, or were never left in one of their ways."""
        lines = {line for line, times in self.lines.items() if not times}
        return sorted(lines | {line for (line, _), times in self.branches.items() if not times})


def coverage(program: Program, counts: Path) -> dict[str, Coverage]:
    """What gcov says of the core's files by name, headers included, over all that compile them."""
    for notes in program.path.parent.glob("*.gcno"):
        if notes.parent != counts:
            shutil.copy(notes, counts)
    command = [
        "gcov",
        "--json-format",
        "--stdout",
        "--branch-probabilities",
        *map(str, counts.glob("*.gcda")),
    ]
    done = subprocess.run(command, capture_output=True, check=True, cwd=counts)
    text = gzip.decompress(done.stdout) if done.stdout[:2] == b"\x1f\x8b" else done.stdout
    found: dict[str, Coverage] = {}
    for document in map(json.loads, text.splitlines()):
        for file in document["files"]:
            path = Path(file["file"])
            if path.parent != CORE:
                continue
            of = found.setdefault(path.name, Coverage())
            for line in file["lines"]:
                number = line["line_number"]
                of.lines[number] = of.lines.get(number, 0) + line["count"]
                for k, branch in enumerate(line["branches"]):
                    of.branches[number, k] = of.branches.get((number, k), 0) + branch["count"]
    return found
