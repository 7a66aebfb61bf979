"""Frames per second and latency of the buses that need no hardware, in one table.

python -m tests.benchmarks.buses [FRAMES] [JSON]

Two nodes in two processes, 8 bytes of data; `virtual`, which lives in one process, in two threads. Latency:
half of the way there and back, one frame at a time. Rate: frames in windows of 100, which every bus can hold,
each acknowledged by one frame. Lost: of as many frames sent on end, as fast as the bus takes them. SocketCAN
is measured where vcan0 is: natively, or by `with-vcan` before this whole command.
"""

import json
import subprocess
import sys
import threading
import time
from pathlib import Path

import can

from bench.bus.hub.client import HubBus

CHANNELS = {
    "virtual": "benchmark",
    "strokebench": "benchmark",
    "udp_multicast": "239.74.163.9",
    "socketcan": "vcan0",
}
FRAMES = 50_000
ROUNDS = 2_000
WINDOW = 100
GO, DATA = 1, 2
PATIENCE_S = 1.0
LABELS = ("p50 us", "p99 us", "frames/s", "lost")


def open_bus(interface: str) -> can.BusABC:
    """A node on the bus; of ours also where its entry point is not installed."""
    if interface == "strokebench":
        return HubBus(CHANNELS[interface])
    return can.Bus(interface=interface, channel=CHANNELS[interface])


def message(identifier: int) -> can.Message:
    """A frame of 8 bytes."""
    return can.Message(arbitration_id=identifier, is_extended_id=False, data=bytes(8))


def heard(bus: can.BusABC, own: int, timeout: float = 20.0) -> can.Message | None:
    """The next frame that is not one of our own, which some buses return."""
    while (got := bus.recv(timeout)) is not None and got.arbitration_id == own:
        pass
    return got


def peer(interface: str, frames: int) -> None:
    """The other end: answers frame by frame, then sends in windows, then on end."""
    with open_bus(interface) as bus:
        data = message(GO)
        bus.send(data)
        for _ in range(ROUNDS):
            if heard(bus, GO) is None:
                return
            bus.send(data)
        for _ in range(frames // WINDOW):
            if heard(bus, GO) is None:
                return
            for _ in range(WINDOW):
                send(bus, data)
        if heard(bus, GO) is None:
            return
        for _ in range(frames):
            send(bus, data)
        heard(bus, GO)  # until the other end has counted


def send(bus: can.BusABC, data: can.Message) -> None:
    """Send, waiting where the kernel's queue is full."""
    while True:
        try:
            return bus.send(data, timeout=1.0)
        except can.CanError as error:
            if "buffer" not in str(error).lower():
                raise


def measure(interface: str, frames: int) -> dict[str, float]:
    """Latency, rate and losses of one interface."""
    with open_bus(interface) as bus:
        if interface == "virtual":
            other = threading.Thread(target=peer, args=(interface, frames))
            other.start()
        else:
            words = [sys.executable, "-m", "tests.benchmarks.buses", "--peer", interface, str(frames)]
            process = subprocess.Popen(words)
        assert heard(bus, DATA) is not None, f"{interface}: the other end does not answer"
        asks, ways = message(DATA), []
        for _ in range(ROUNDS):
            begun = time.perf_counter()
            bus.send(asks)
            heard(bus, DATA)
            ways.append((time.perf_counter() - begun) / 2 * 1e6)
        begun = time.perf_counter()
        for _ in range(frames // WINDOW):
            bus.send(asks)
            for _ in range(WINDOW):
                heard(bus, DATA)
        rate = frames // WINDOW * WINDOW / (time.perf_counter() - begun)
        bus.send(asks)
        count = 0
        while count < frames and heard(bus, DATA, PATIENCE_S) is not None:
            count += 1
        bus.send(asks)
        if interface == "virtual":
            other.join()
        else:
            process.wait()
    ways.sort()
    figures = ways[len(ways) // 2], ways[len(ways) * 99 // 100], rate, float(frames - count)
    return dict(zip(LABELS, figures, strict=True))


def main(words: list[str]) -> None:
    """Print a line for each interface, and why one is missing."""
    if words[:1] == ["--peer"]:
        peer(words[1], int(words[2]))
        return
    frames = int(words[0]) if words else FRAMES
    found: dict[str, dict[str, float]] = {}
    print(f"{'':14}" + "".join(f"{label:>12}" for label in LABELS))
    for interface in CHANNELS:
        try:
            found[interface] = measure(interface, frames)
        except (can.CanError, OSError) as error:
            print(f"{interface:14} not here: {error}")
            continue
        print(
            f"{interface:14}" + "".join(f"{value:12.0f}" for value in found[interface].values()), flush=True
        )
    if words[1:]:
        Path(words[1]).write_text(json.dumps(found, indent=1))


if __name__ == "__main__":
    main(sys.argv[1:])
