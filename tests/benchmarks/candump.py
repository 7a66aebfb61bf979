"""Frames per second of our candump reader and of python-can's, on the same files in the same process.

python -m tests.benchmarks.candump FILE...
"""

import sys
import time
from pathlib import Path

import can

from bench.laps.can.candump import parse

LEAST_S = 1.0


def rate(read) -> tuple[int, float]:
    """Frames that `read` returns, and how many of them a second over at least LEAST_S of it."""
    frames, runs, begun = 0, 0, time.perf_counter()
    while not runs or time.perf_counter() - begun < LEAST_S:
        frames = read()
        runs += 1
    return frames, runs * frames / (time.perf_counter() - begun)


def main(paths: list[Path]) -> None:
    """Print a line for each file."""
    parse(b"(0.0) can0 100#00\n", "")  # compiled before it is measured
    for path in paths:
        ours, our_rate = rate(lambda path=path: len(parse(path.read_bytes(), str(path))))
        theirs, their_rate = rate(lambda path=path: sum(1 for _ in can.LogReader(path)))
        print(
            f"{path.name}: {ours} frames, {our_rate / 1e6:.2f} M/s; python-can {theirs} frames, "
            f"{their_rate / 1e6:.3f} M/s; {our_rate / their_rate:.0f} times"
        )


if __name__ == "__main__":
    main([Path(name) for name in sys.argv[1:]])
