"""A connection to a channel's hub, which is started if there is none.

Belongs here: reaching a hub. Never: frames.
"""

import os
import select
import socket
import subprocess
import sys
import time
from pathlib import Path

from bench.bus.hub import wire
from bench.bus.hub.place import Place, channels
from bench.bus.hub.server import READY, TAKEN
from bench.errors import BusError

PATIENCE_S = 10.0
"""How long to try; starting a hub takes a tenth of a second, on a machine that is busy with other things."""
_PAUSE_S = 0.01
_ROOT = Path(__file__).resolve().parents[3]
"""Where the hub's process finds this package, whatever its own paths are."""


def connect(channel: str, own: bool, timed: int | None = None) -> tuple[socket.socket, int | None, bytes]:
    """A greeted connection, the hub's bit rate (None: untimed), and what has come behind its greeting.

    own: the client wants to hear what it sends. timed: the bit rate it asks for; None: any. Raises BusError
    if the hub refuses, or none can be had.
    """
    if timed is not None and not 1 <= timed <= 1_000_000:
        raise BusError(f"bit rate {timed} bit/s is not within 1 to 1000000, the range of classic CAN")
    place = Place.of(channel)
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        end = _reach(place)
        if end is None:
            _start(channel, timed or 0, deadline)
            continue
        try:
            welcome, more = _greet(end, own, timed, deadline)
        except OSError:  # the hub was about to end
            end.close()
            time.sleep(_PAUSE_S)
            continue
        if welcome.kind == wire.REFUSED:
            end.close()
            raise BusError(f"strokebench:{channel}: {wire.text(welcome)}")
        if welcome.dlc != wire.VERSION:
            end.close()
            raise BusError(
                f"strokebench:{channel}: the hub speaks version {welcome.dlc}, this client {wire.VERSION}"
            )
        end.setblocking(False)
        return end, welcome.id or None, more
    raise BusError(f"strokebench:{channel}: no hub answers within {PATIENCE_S:g} s at {place.socket}")


def running() -> list[str]:
    """The channels whose hub takes connections."""
    found = []
    for channel in channels():
        end = _reach(Place.of(channel))
        if end is not None:
            end.close()
            found.append(channel)
    return found


def _reach(place: Place) -> socket.socket | None:
    end = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        end.connect(str(place.socket))
    except (FileNotFoundError, ConnectionRefusedError):
        end.close()
        return None
    except OSError as error:
        end.close()
        raise BusError(f"{place.socket}: {error.strerror}") from None
    return end


def _greet(end: socket.socket, own: bool, timed: int | None, deadline: float) -> tuple[wire.Record, bytes]:
    """The hub's answer to HELLO, and what came behind it; OSError if it ends instead."""
    end.settimeout(max(deadline - time.monotonic(), _PAUSE_S))
    end.sendall(wire.pack(wire.HELLO, wire.OWN if own else 0, wire.VERSION, timed or 0))
    heard = b""
    while True:
        data = end.recv(1 << 12)
        if not data:
            raise ConnectionResetError
        heard += data
        for at, record in wire.whole(heard):
            return record, heard[at:]


def _start(channel: str, timed: int, deadline: float) -> None:
    """Start a hub and wait until it, or another one that was quicker, is there; BusError if it cannot be."""
    paths = os.pathsep.join([str(_ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
    process = subprocess.Popen(
        [sys.executable, "-m", "bench.bus.hub.server", channel, str(timed)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        cwd="/",
        env={**os.environ, "PYTHONPATH": paths},
        start_new_session=True,  # Ctrl-C at its starter's terminal is not meant for it
    )
    assert process.stdout is not None
    with process.stdout as said:
        ready, _, _ = select.select([said], [], [], max(deadline - time.monotonic(), 0))
        word = said.readline().decode(errors="replace").strip() if ready else ""
    process.wait()  # the hub is its child, and outlives it
    if word == TAKEN:
        time.sleep(_PAUSE_S)  # that one is about to be there, or about to go
    elif word != READY:
        raise BusError(word or f"strokebench:{channel}: a hub does not start")
