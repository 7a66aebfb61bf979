"""Jobs in worker processes: order, exceptions, workers that die, loops that end early."""

import multiprocessing
import os
import signal
import time
from contextlib import suppress
from multiprocessing.connection import Connection

import pytest

from bench.errors import BenchError, LapError
from bench.pool import WorkersLost, as_completed, results


def slow_first(k):
    time.sleep(0.2 if k == 0 else 0.0)
    return k, os.getpid()


def refuses(k):
    if k == 2:
        raise LapError("lap 2 is bad")
    return k


def slow_but_2(k):
    time.sleep(0.0 if k == 2 else 0.1)
    return refuses(k)


def dies(job):
    k, number = job
    if k == 3:
        os.kill(os.getpid(), number)
        time.sleep(10)
    return k


def dies_while_sending(_):
    """Killed when the first half of its result is sent."""
    plain = Connection._send

    def half(pipe, data, *write):
        if len(data) > 1000:
            plain(pipe, data[: len(data) // 2], *write)
            os.kill(os.getpid(), signal.SIGKILL)
        plain(pipe, data, *write)

    Connection._send = half
    return bytes(1_000_000)


def slow_and_dies(job):
    time.sleep(0.0 if job[0] == 3 else 0.1)
    return dies(job)


class Odd(Exception):
    """Cannot be unpickled: its argument is not the one of its constructor."""

    def __init__(self, one, other):
        super().__init__(f"{one} and {other}")


def raises_oddly(k):
    raise Odd(k, "so on")


def unsendable(k):
    return lambda: k


def waits_for_4(job):
    path, k = job
    while k == 0 and not (path / "4").exists():
        time.sleep(0.01)
    return note(job)


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


def test_killed_while_sending():
    """A worker killed with half its result sent keeps nobody waiting for the rest."""
    with pytest.raises(WorkersLost, match="a worker was killed; 0 of 2 jobs are done"):
        list(results(dies_while_sending, [1, 2], 2))


def test_killed_beside_others():
    """What the other workers were at when one was killed is handed out before the refusal."""
    done = []
    jobs = [(k, signal.SIGKILL) for k in (3, 0, 1)]
    with pytest.raises(WorkersLost, match="a worker was killed; 2 of 3 jobs are done"):
        done.extend(as_completed(slow_and_dies, jobs, 3))
    assert sorted(done) == [(1, 0), (2, 1)]


def test_loop_left_early(tmp_path):
    """Where the loop is left no further job begins; those that run are finished."""
    ridden = results(note, [(tmp_path, k) for k in range(500)], 2)
    assert next(ridden) == 0
    ridden.close()
    count = len(list(tmp_path.iterdir()))
    assert count < 20
    time.sleep(0.1)
    assert len(list(tmp_path.iterdir())) == count


def test_no_workers_left(tmp_path):
    """However the loop ends, its processes have ended."""
    for jobs in ([(tmp_path, k) for k in range(9)], [(tmp_path / "nowhere", 0)] * 9):
        loop = as_completed(note, jobs, 3)
        with suppress(FileNotFoundError):
            next(loop)
        loop.close()
        assert multiprocessing.active_children() == []


@pytest.mark.parametrize("workers", [1, 2, 5])
def test_as_completed(workers):
    """Every result comes once, with the index of its job."""
    found = list(as_completed(abs, range(0, -20, -1), workers))
    assert sorted(found) == [(k, k) for k in range(20)]


def test_first_come(tmp_path):
    """A result that is there does not wait for those before it."""
    assert [k for k, _ in as_completed(waits_for_4, [(tmp_path, k) for k in range(5)], 2)][-1] == 0


@pytest.mark.parametrize("workers", [1, 3])
def test_stop(workers, tmp_path):
    """Once asked to stop no job begins; those that run are handed out."""
    done = []
    for _, k in as_completed(note, [(tmp_path, k) for k in range(50)], workers, lambda: len(done) >= 4):
        done.append(k)
    assert 4 <= len(done) < 4 + workers
    assert {int(file.name) for file in tmp_path.iterdir()} == set(done)


def test_others_before_the_exception():
    """What other workers were at when a job raised is handed out before the exception."""
    done = []
    with pytest.raises(LapError, match="lap 2 is bad"):
        done.extend(as_completed(slow_but_2, [0, 2, 1], 3))
    assert sorted(done) == [(0, 0), (2, 1)]


def test_where_it_was_raised():
    """An exception from a worker tells where in it that was."""
    with pytest.raises(LapError) as refusal:
        list(results(refuses, [2, 2], 2))
    assert "in refuses" in refusal.value.__notes__[0]


def test_exception_that_cannot_travel():
    """An exception that cannot be unpickled is told in its words.

    Dask, where another test has loaded it, teaches pickle to carry this one after all.
    """
    with pytest.raises((RuntimeError, Odd), match="0 and so on"):
        list(results(raises_oddly, [0, 0], 2))


def test_result_that_cannot_travel():
    """A result that cannot be pickled is an exception, not a worker that dies."""
    with pytest.raises((AttributeError, TypeError, RuntimeError), match="lambda"):
        list(results(unsendable, [0, 1], 2))


def test_no_jobs():
    """No jobs, no results."""
    assert list(results(refuses, [], 4)) == []
