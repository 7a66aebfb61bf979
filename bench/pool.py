"""Jobs in worker processes.

Belongs here: starting, interrupting and losing workers. Never: what a job is about.

Each worker has a pipe of its own. A pool whose workers share queues, as the standard library's do, waits for
ever where one is killed in the middle of a result or with a queue's lock in its hand.
"""

import multiprocessing
import pickle
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Generator, Sequence
from multiprocessing.connection import Connection, wait
from typing import Any, NoReturn, TypeVar

from bench.errors import BenchError

Job = TypeVar("Job")
Result = TypeVar("Result")


_FORKS = "fork" in multiprocessing.get_all_start_methods()


class WorkersLost(BenchError):
    """Who should carry out the jobs was ended from outside; what the others were at has been handed out."""

    def __init__(self, reason: str, progress: str) -> None:
        super().__init__(f"{reason}; {progress}")
        self.reason = reason


def results(
    work: Callable[[Job], Result], jobs: Sequence[Job], workers: int
) -> Generator[Result, None, None]:
    """`work` of each job, as soon as that and all before it are there; for the rest see `as_completed`."""
    waiting: dict[int, Result] = {}
    told = 0
    for k, result in as_completed(work, jobs, workers):
        waiting[k] = result
        while told in waiting:
            yield waiting.pop(told)
            told += 1


def as_completed(
    work: Callable[[Job], Result],
    jobs: Sequence[Job],
    workers: int,
    stop: Callable[[], bool] = lambda: False,
) -> Generator[tuple[int, Result], None, None]:
    """(index of the job, `work` of it) as each one ends; in this process if `workers` is 1.

    They travel between processes by pickling. No further job begins once `stop()`, asked before each, says
    so, or once one has raised: those that run are handed out, then its exception is raised here. Where the
    loop over the results is left early, by Ctrl-C or any exception, those that run are waited for.
    Raises WorkersLost, after what the others were at, if one was killed from outside.
    """
    workers = min(workers, len(jobs))
    if workers <= 1:
        for k, job in enumerate(jobs):
            if stop():
                return
            yield k, work(job)
        return
    pool = _Pool(work, workers)
    idle, running = list(pool.pipes), dict[Connection, int]()
    given = done = 0
    killed, raised = False, None
    try:
        while True:
            while idle and given < len(jobs) and not (killed or raised or stop()):
                pipe = idle.pop()
                killed = not _send(pipe, jobs[given])
                if not killed:
                    running[pipe] = given
                    given += 1
            if not running:
                break
            for pipe in [pipe for pipe in wait(list(running)) if isinstance(pipe, Connection)]:
                k = running.pop(pipe)
                try:
                    reply = pipe.recv_bytes()
                except (EOFError, OSError):  # nobody else holds the other end: its process is gone
                    killed = True
                    continue
                idle.append(pipe)
                result, error = pickle.loads(reply)
                if error is None:
                    done += 1
                    yield k, result
                else:
                    raised = raised or error
    finally:
        pool.close()
    if raised:
        raise raised
    if killed:
        raise WorkersLost("a worker was killed", f"{done} of {len(jobs)} jobs are done")


def _send(pipe: Connection, job: Any) -> bool:
    """Whether somebody is there to take it."""
    try:
        pipe.send(job)
    except (BrokenPipeError, ConnectionResetError):
        return False
    return True


class _Pool:
    """Worker processes and this process's ends of their pipes."""

    def __init__(self, work: Callable[[Any], Any], workers: int) -> None:
        # Forked workers have what is compiled already.
        context: Any = multiprocessing.get_context("fork" if _FORKS else "spawn")
        self.pipes: list[Connection] = []
        self._processes: list[Any] = []
        try:
            for _ in range(workers):
                ours, theirs = context.Pipe()
                self.pipes.append(ours)
                process = context.Process(target=_serve, args=(work, theirs, self.pipes if _FORKS else ()))
                process.start()
                self._processes.append(process)
                theirs.close()  # the only other one is the worker's: the pipe ends with it
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Let every worker end with the job it is at."""
        for pipe in self.pipes:
            pipe.close()
        try:
            for process in self._processes:
                process.join()
        except BaseException:  # who presses Ctrl-C twice does not want to wait
            for process in self._processes:
                process.terminate()
            raise


def _serve(work: Callable[[Any], Any], pipe: Connection, inherited: Sequence[Connection]) -> None:
    # Ctrl-C reaches the whole group: the parent ends the pool, the workers say nothing of their own.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # An exception, so that a file half-written is cleared away.
    signal.signal(signal.SIGTERM, _leave)
    threading.Thread(target=_follow_parent, daemon=True).start()
    for end in inherited:  # else no pipe would end with the parent
        end.close()
    while True:
        try:
            job = pipe.recv()
        except (EOFError, OSError):
            return
        try:
            reply = pickle.dumps((work(job), None))
        except Exception as error:
            reply = pickle.dumps((None, _portable(error)))
        try:
            pipe.send_bytes(reply)
        except OSError:  # the parent no longer wants it
            return


def _portable(error: Exception) -> Exception:
    """The exception with where it was raised, or what stands for one that cannot travel."""
    error.add_note("".join(traceback.format_exception(error)).rstrip())
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return RuntimeError(f"{type(error).__name__}: {error}")
    return error


def _follow_parent() -> None:
    """End this worker where its parent was killed: nobody is left to take the result or to send SIGTERM."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    # To the main thread, which may sleep in a system call that only a signal of its own interrupts.
    main = threading.main_thread().ident
    assert main is not None
    signal.pthread_kill(main, signal.SIGTERM)


def _leave(*_: object) -> NoReturn:
    sys.exit(1)
