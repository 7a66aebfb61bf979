"""What simulated laps cost: CPU seconds, memory, and how both grow with their number.

python -m tests.benchmarks.laps [COUNT...]
"""

import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path


def _one(count: int) -> None:
    """Ride and write `count` laps in this process; print CPU time after warm-up and the peak of memory."""
    from bench.laps import write_lap
    from bench.plant.motorcycle import load_motorcycle
    from bench.plant.ride import ride
    from bench.plant.route import load_route

    route, machine = load_route("test_lap"), load_motorcycle()
    ride(route, machine, 0, seconds=1.0)
    with tempfile.TemporaryDirectory() as folder:
        began, simulated, bytes_written = time.process_time(), 0.0, 0
        in_ride = 0.0
        for seed in range(count):
            start = time.process_time()
            lap = ride(route, machine, seed)
            in_ride += time.process_time() - start
            simulated += lap.duration_ns / 1e9
            path = Path(folder) / f"lap-{seed}.parquet"
            write_lap(lap, path)
            bytes_written += path.stat().st_size
        spent = time.process_time() - began
    peak_mib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(
        f"{count:5d} laps of {simulated / count:4.0f} s: {in_ride / simulated * 300:6.3f} s CPU per 300 s, "
        f"{spent / simulated * 300:6.3f} s with writing, {spent:7.2f} s in all, peak {peak_mib:5.0f} MiB, "
        f"{bytes_written / count / 2**20:5.1f} MiB a lap on disk"
    )


if __name__ == "__main__":
    if sys.argv[1:2] == ["--one"]:
        _one(int(sys.argv[2]))
    else:
        # a process for each, so that a peak is its own
        for count in sys.argv[1:] or ["1", "10", "100"]:
            subprocess.run([sys.executable, "-m", "tests.benchmarks.laps", "--one", count], check=True)
