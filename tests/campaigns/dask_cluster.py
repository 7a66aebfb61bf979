"""A Dask cluster of this machine's own, as a script: prints its address, lives until its input ends.

    python dask_cluster.py WORKERS [PIDS]

PIDS gets the workers' process ids; these are not started again when killed, as those of a LocalCluster are.
"""

import os
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def cluster(workers, pids=None, path=()):
    """The script running: yields its process and the scheduler's address. path: goes before PYTHONPATH."""
    env = {**os.environ, "PYTHONPATH": ":".join([*map(str, path), os.environ["PYTHONPATH"]])}
    words = [sys.executable, __file__, str(workers), *([str(pids)] if pids else [])]
    process = subprocess.Popen(
        words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, env=env
    )
    try:
        address = process.stdout.readline().strip()
        assert address.startswith("tcp://127.0.0.1:")
        yield process, address
    finally:
        process.stdin.close()
        try:
            process.wait(timeout=20)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        process.stdout.close()


def main(workers, pids=None):
    import dask
    from distributed import LocalCluster

    if not pids:
        dask.config.set({"distributed.scheduler.allowed-failures": 1})
    here = {"host": "127.0.0.1", "dashboard_address": None, "threads_per_worker": 1, "processes": True}
    children = []
    with LocalCluster(n_workers=0 if pids else int(workers), **here) as found:
        if pids:
            words = [sys.executable, "-m", "distributed.cli.dask_worker", found.scheduler_address]
            words += ["--no-nanny", "--no-dashboard", "--nthreads", "2", "--host", "127.0.0.1"]
            children = [subprocess.Popen(words) for _ in range(int(workers))]
            Path(pids).write_text("\n".join(str(child.pid) for child in children))
        while len(found.scheduler.workers) < int(workers):
            time.sleep(0.05)
        print(found.scheduler_address, flush=True)
        sys.stdin.read()
        for child in children:
            child.kill()


if __name__ == "__main__":
    main(*sys.argv[1:])
