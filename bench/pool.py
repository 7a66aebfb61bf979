"""Jobs in worker processes: their results in the jobs' order, whatever finished first.

Belongs here: starting, interrupting and losing workers. Never: what a job is about.
"""

import multiprocessing
import signal
import sys
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Any, NoReturn, TypeVar

from bench.errors import BenchError

Job = TypeVar("Job")
Result = TypeVar("Result")


def results(
    work: Callable[[Job], Result], jobs: Sequence[Job], workers: int
) -> Generator[Result, None, None]:
    """`work` of each job, as soon as that and all before it are there; in this process if `workers` is 1.

    They travel between processes by pickling. Where the loop over the results is left early, by Ctrl-C or any
    exception, no further job begins, and those that run are waited for. A job's own exception is raised here.
    Raises BenchError if a worker was killed from outside.
    """
    workers = min(workers, len(jobs))
    if workers <= 1:
        yield from map(work, jobs)
        return
    done: dict[int, Result] = {}
    given, told = 0, 0
    running: dict[Future[Result], int] = {}
    with ProcessPoolExecutor(workers, _context(), _start, (work,)) as pool:
        try:
            while told < len(jobs):
                # No more than can run: what the pool's queue holds cannot be taken back.
                while given < len(jobs) and len(running) < workers:
                    running[pool.submit(_carry_out, jobs[given])] = given
                    given += 1
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    done[running.pop(future)] = future.result()
                while told in done:
                    yield done.pop(told)
                    told += 1
        except (BrokenProcessPool, SystemExit):
            raise BenchError(f"a worker was killed; {told} of {len(jobs)} jobs are done") from None


def _context() -> multiprocessing.context.BaseContext:
    # Forked workers have what is compiled already.
    methods = multiprocessing.get_all_start_methods()
    return multiprocessing.get_context("fork" if "fork" in methods else "spawn")


_work: Callable[[Any], Any] | None = None


def _start(work: Callable[[Any], Any]) -> None:
    global _work  # noqa: PLW0603  # handed to a worker once instead of with every job
    _work = work
    # Ctrl-C reaches the whole group: the parent ends the pool, the workers say nothing of their own.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # An exception, so that a file half-written is cleared away.
    signal.signal(signal.SIGTERM, _leave)


def _leave(*_: object) -> NoReturn:
    sys.exit(1)


def _carry_out(job: Any) -> Any:
    assert _work is not None
    return _work(job)
