"""An ECU put on a live bus for one test: a process of its own, or a thread where the bus ends at the process.

Belongs here: starting and stopping it, and what it says at its end. Never: what it does on the bus (serve).
"""

import gc
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from tempfile import NamedTemporaryFile

from bench.bus.live import Heard, LiveBus
from bench.errors import BenchError, BusError
from bench.serve import Served, rehearse, serve
from targets.calibration import dumps
from targets.ecu import Frame
from targets.ecus import Build
from targets.errors import TargetError

PATIENCE_S = 180.0
"""How long an ECU may take to be ready: the first one of a machine compiles."""

STOP_S = 10.0
"""How long it may take to end; then it is killed."""

WITHIN_PROCESS = "virtual"
"""The interface of python-can that no other process can hear."""

_COMPLAINTS = ("bench: ", "did not keep up")
"""How the lines of `bench ecu` begin that are no good news."""


@contextmanager
def attached(build: Build, bus: str, bitrate: int, limit_ns: int, complaints: list[str]) -> Iterator[None]:
    """An ECU of `build` on `bus` for the block; what it complains of at its end joins `complaints`.

    limit_ns: by how much it may lag behind the clock.

    Raises BusError if it does not get ready.
    """
    here = bus.partition(":")[0] == WITHIN_PROCESS
    with (_thread if here else _process)(build, bus, bitrate, limit_ns, complaints):
        yield


@contextmanager
def _process(build: Build, bus: str, bitrate: int, limit_ns: int, complaints: list[str]) -> Iterator[None]:
    with NamedTemporaryFile("w", suffix=".json", encoding="utf-8") as model:
        model.write(dumps(build.calibration))
        model.flush()
        words = [
            build.role,
            "--bus",
            bus,
            "--bitrate",
            str(bitrate),
            "--on",
            build.host,
            "--model",
            model.name,
            "--late-limit",
            str(limit_ns / 1e6),
        ]
        if build.host == "mcu":
            words += ["--elf", build.image.source]
        # -P: not what lies in the working directory, but the packages that this process has
        command = [sys.executable, "-P", "-m", "bench.cli.main", "ecu", *words]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            env=environment,
        )
        try:
            _await_ready(process, build.role)
            yield
        finally:
            complaints += _ended(process, build.role)


def _await_ready(process: subprocess.Popen[str], role: str) -> None:
    assert process.stderr is not None
    impatience = threading.Timer(PATIENCE_S, process.kill)
    impatience.start()
    said = ""
    try:
        for said in process.stderr:
            if said.startswith(f"ecu {role} on "):
                return
    finally:
        impatience.cancel()
    reason = said.strip().removeprefix("bench: ") or f"it said nothing for {PATIENCE_S:g} s"
    raise BusError(f"ecu {role} did not get ready: {reason}")


def _ended(process: subprocess.Popen[str], role: str) -> list[str]:
    """Stop it; what it complained of."""
    assert process.stderr is not None
    with suppress(ProcessLookupError):
        process.send_signal(signal.SIGINT)
    impatience = threading.Timer(STOP_S, process.kill)
    impatience.start()
    said = process.stderr.read()  # communicate() would miss what was read ahead with the line that said ready
    process.wait()
    process.stderr.close()
    impatience.cancel()
    if process.returncode == -signal.SIGKILL:
        return [f"ecu {role}: did not stop within {STOP_S:g} s"]
    found = [f"ecu {role}: {line}" for line in said.splitlines() if line.startswith(_COMPLAINTS)]
    if not found and process.returncode not in (0, -signal.SIGINT):
        found.append(f"ecu {role}: ended with exit code {process.returncode}")
    return found


class _Ended(Exception):
    """The test is over."""


class _Until:
    """A bus that ends the ECU on it once `over` is set."""

    def __init__(self, bus: LiveBus, over: threading.Event) -> None:
        self._bus, self._over = bus, over
        self.echoes = bus.echoes

    @property
    def refusal(self) -> str:
        return self._bus.refusal

    def send(self, frame: Frame, timeout_s: float = 0.0) -> bool:
        return self._bus.send(frame, timeout_s)

    def receive(self, timeout_s: float) -> Heard | None:
        if self._over.is_set():
            raise _Ended
        return self._bus.receive(timeout_s)


@contextmanager
def _thread(build: Build, bus: str, bitrate: int, limit_ns: int, complaints: list[str]) -> Iterator[None]:
    ready, over, served = threading.Event(), threading.Event(), Served(limit_ns)
    rehearse(build.power_on(bitrate))
    device = build.power_on(bitrate)
    failed: list[str] = []

    def live() -> None:
        try:
            serve(device, _Until(there, over), ready=ready.set, served=served)
        except _Ended:
            pass
        except (BenchError, TargetError) as error:
            failed.append(f"ecu {build.role}: {error.side}: {error}")
            ready.set()

    with LiveBus(bus, bitrate) as there:
        thread = threading.Thread(target=live, name=f"ecu {build.role}")
        thread.start()
        try:
            if not ready.wait(PATIENCE_S) or failed:
                raise BusError("; ".join(failed) or f"ecu {build.role} did not get ready")
            yield
        finally:
            over.set()
            thread.join()
            gc.unfreeze()  # an ECU freezes what its process has imported; this process goes on
    complaints += failed
    if complaint := served.complaint():
        complaints.append(f"ecu {build.role}: {complaint}")
