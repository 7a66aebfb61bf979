"""Jobs in worker processes: order, exceptions, workers that die, loops that end early."""

import os
import signal
import time

import pytest

from bench.errors import BenchError, LapError
from bench.pool import results


def slow_first(k):
    time.sleep(0.2 if k == 0 else 0.0)
    return k, os.getpid()


def refuses(k):
    if k == 2:
        raise LapError("lap 2 is bad")
    return k


def dies(job):
    k, number = job
    if k == 3:
        os.kill(os.getpid(), number)
        time.sleep(10)
    return k


def note(job):
    path, k = job
    time.sleep(0.02)
    (path / str(k)).touch()
    return k


@pytest.mark.parametrize("workers", [1, 2, 5])
def test_order(workers):
    """Results come in the order of the jobs, whatever finished first."""
    assert [k for k, _ in results(slow_first, range(7), workers)] == list(range(7))


def test_processes():
    """One worker is this process, several are others."""
    assert {pid for _, pid in results(slow_first, [1, 2], 1)} == {os.getpid()}
    assert os.getpid() not in {pid for _, pid in results(slow_first, [1, 2], 2)}


@pytest.mark.parametrize("workers", [1, 2])
def test_exception(workers):
    """A job's exception is raised where its result would have been, as it was."""
    seen = []
    with pytest.raises(LapError, match="lap 2 is bad"):
        seen.extend(results(refuses, range(9), workers))
    assert set(seen) <= {0, 1}


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_killed_worker(number):
    """A worker killed from outside ends the loop with one line that says how far it came."""
    with pytest.raises(BenchError, match=r"a worker was killed; \d of 8 jobs are done"):
        list(results(dies, [(k, number) for k in range(8)], 2))


def test_loop_left_early(tmp_path):
    """Where the loop is left no further job begins; those that run are finished."""
    ridden = results(note, [(tmp_path, k) for k in range(500)], 2)
    assert next(ridden) == 0
    ridden.close()
    count = len(list(tmp_path.iterdir()))
    assert count < 20
    time.sleep(0.1)
    assert len(list(tmp_path.iterdir())) == count


def test_no_jobs():
    """No jobs, no results."""
    assert list(results(refuses, [], 4)) == []
