"""Trials on a Dask cluster: the executor for more than one machine.

Belongs here: a scheduler's address, its workers, every way in which they can be lost. Never: what a job is.
Jobs and results travel by pickling: whoever runs the cluster runs code here, and we there.
"""

import logging
import pickle
import queue
import re
import threading
import time
import warnings
from asyncio import CancelledError
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import TYPE_CHECKING, Any

from bench import pool
from bench.provenance import versions
from bench.quiet import quiet
from campaigns.errors import CampaignError

if TYPE_CHECKING:
    from distributed import Client, Future

AHEAD = 2
"""Trials handed out for each worker: one that runs and one that waits, so that no worker does."""
POLL_S = 1.0
"""How often, where nothing comes, it is asked whether anything still can."""


@dataclass(frozen=True)
class Cluster:
    """The scheduler at `url`, tcp://HOST:PORT; see `campaigns.runner.Executor`.

    connect_s: how long it is waited for. patience_s: how long for a first worker after the last one is gone.
    """

    url: str
    connect_s: float = 5.0
    patience_s: float = 20.0

    def as_completed(
        self, work: Callable[[Any], Any], jobs: Sequence[Any], stop: Callable[[], bool]
    ) -> Generator[tuple[int, Any], None, None]:
        """(index of the job, `work` of it) as each one ends; no further one is handed out once `stop()`.

        A trial whose worker was killed is given to another one. Raises CampaignError where there is no
        cluster or its software is not ours, WorkersLost where it goes away.
        """
        if not jobs:
            return
        with self._client() as client:
            self._check_workers(client)
            run = _Run(self, client, work, jobs)
            raised: BaseException | None = None
            while True:
                while raised is None and run.has_room() and not stop():
                    run.hand_out()
                if not run.running:
                    break
                k, result, error = run.next()
                if error is None:
                    yield k, result
                else:
                    raised = raised or error
            if raised is not None:
                raise raised

    @contextmanager
    def _client(self) -> Iterator["Client"]:
        if not re.fullmatch(r"tcp://[^\s/]+:\d{1,5}", self.url):
            raise CampaignError(f"cluster {self.url}: is no address; one looks like tcp://10.0.0.1:8786")
        try:
            from distributed import Client
        except ImportError:
            how = "pip install 'strokebench[cluster]'"
            raise CampaignError(f"cluster {self.url}: needs the package distributed: {how}") from None

        class Silent(Client):
            def __del__(self) -> None:
                with suppress(Exception):  # of one that never reached its scheduler
                    super().__del__()

        with _silence():
            try:
                client = Silent(self.url, timeout=self.connect_s, set_as_default=False)
            except Exception as problem:
                late = f"no scheduler answers within {self.connect_s:g} s"
                reason = (
                    late if isinstance(problem, OSError) else "what answers is no scheduler of this version"
                )
                raise CampaignError(f"cluster {self.url}: {reason}") from None
            try:
                yield client
            finally:
                client.close(timeout=self.connect_s)  # what it has handed out is withdrawn

    def _check_workers(self, client: "Client") -> None:
        """Refuse a cluster without workers, or with one whose software would give other results."""
        try:
            client.run_on_scheduler(_difference, versions())  # it looks into what it hands on
        except Exception as problem:
            raise CampaignError(
                f"cluster {self.url}: its scheduler cannot run strokebench: {problem}"
            ) from None
        try:
            client.wait_for_workers(1, timeout=self.connect_s)
            answers = client.run(_difference, versions(), on_error="return")
        except TimeoutError:
            raise CampaignError(f"cluster {self.url}: has no workers") from None
        except (OSError, RuntimeError) as problem:
            raise CampaignError(f"cluster {self.url}: does not answer: {problem}") from None
        for address, answer in sorted(answers.items()):
            if isinstance(answer, BaseException):
                raise CampaignError(f"cluster {self.url}: worker {address} cannot run strokebench: {answer}")
            if answer:
                raise CampaignError(f"cluster {self.url}: worker {address} has {answer}")


class _Run:
    """Jobs on their way: handed out, not yet back."""

    def __init__(
        self, cluster: Cluster, client: "Client", work: Callable[[Any], Any], jobs: Sequence[Any]
    ) -> None:
        self.running: dict[Future, int] = {}
        self._cluster, self._client, self._jobs = cluster, client, jobs
        self._given = self._done = 0
        self._ended: queue.SimpleQueue[Future] = queue.SimpleQueue()
        self._workers, self._asked_s = 0, float("-inf")
        # A task like the others, that every job takes: it is sent once, workers have it from each other, and
        # where all who had it are lost the scheduler still knows it.
        self._constant = client.submit(_itself, _packed((work, versions())), pure=False)

    def has_room(self) -> bool:
        """Whether a job is left, and a worker that will want it."""
        if self._given == len(self._jobs):
            return False
        if time.monotonic() - self._asked_s > POLL_S:
            self._count_workers()
        return len(self.running) < AHEAD * max(self._workers, 1)

    def hand_out(self) -> None:
        """The next job."""
        job = _packed(self._jobs[self._given])
        try:
            future = self._client.submit(_carry_out, self._constant, job, pure=False)
        except RuntimeError as problem:  # the client has closed itself
            raise self._lost("the scheduler is gone") from problem
        self.running[future] = self._given
        self._given += 1
        future.add_done_callback(self._ended.put)

    def next(self) -> tuple[int, Any, BaseException | None]:
        """(index, result, None) or (index, None, what the job raised) of the next that ends."""
        while True:
            future = self._wait()
            try:
                result, error = self._fetched(future)
            except TimeoutError:  # its worker was killed with the result in its hand: another one is at it
                future.add_done_callback(self._ended.put)
                continue
            self._done += error is None
            # Known no longer: what is stored must not be run again because the worker that ran it is lost.
            future.release()
            return self.running.pop(future), result, error

    def _wait(self) -> "Future":
        since_s = time.monotonic()
        while True:
            try:
                return self._ended.get(timeout=POLL_S)
            except queue.Empty:
                self._count_workers()
            if self._workers:
                since_s = time.monotonic()
            elif time.monotonic() - since_s > self._cluster.patience_s:
                raise self._lost("its last worker is gone")

    def _fetched(self, future: "Future") -> tuple[Any, BaseException | None]:
        from distributed.scheduler import KilledWorker

        try:
            return future.result(timeout=self._cluster.patience_s), None
        except TimeoutError as problem:
            if future.status != "error":
                raise
            return None, problem
        except KilledWorker:
            # Dask counts the deaths of its workers against all that they were given, running or waiting.
            where = f"trial {self._jobs[self.running[future]].id} or one beside it"
            raise self._lost(f"one worker after the other was killed at {where}") from None
        except (Exception, CancelledError) as problem:
            if future.status != "error":
                raise self._lost("the scheduler is gone") from problem
            return None, problem

    def _count_workers(self) -> None:
        self._asked_s = time.monotonic()
        scheduler: Any = self._client.scheduler
        try:
            answer = self._client.sync(scheduler.ncores, callback_timeout=self._cluster.patience_s)
        except (Exception, CancelledError) as problem:  # whatever it is called: nobody is there to be asked
            raise self._lost("the scheduler is gone") from problem
        self._workers = len(answer)

    def _lost(self, reason: str) -> pool.WorkersLost:
        progress = f"{self._done} of {len(self._jobs)} jobs are done"
        return pool.WorkersLost(f"cluster {self._cluster.url}: {reason}", progress)


@contextmanager
def _silence() -> Iterator[None]:
    """Let Dask say nothing on the error stream of what is refused in one line here, or mended."""
    import distributed  # noqa: F401  # sets its loggers' levels when it is imported

    with ExitStack() as stack:
        # Those below "distributed" that have a level of their own do not heed its.
        for name in [*logging.root.manager.loggerDict, "asyncio"]:
            if name.split(".")[0] in ("distributed", "tornado", "asyncio"):
                stack.enter_context(quiet(name))
        stack.enter_context(warnings.catch_warnings())
        warnings.filterwarnings("ignore", module=r"distributed|campaigns\.cluster")
        yield


def _packed(what: Any) -> bytes:
    """Pickled here, not by Dask: its scheduler would unpack it, and need what only workers need."""
    import cloudpickle  # type: ignore[import-untyped]  # comes with distributed

    packed: bytes = cloudpickle.dumps(what)
    return packed


# What follows runs on the workers.

_one_at_a_time = threading.Lock()
"""As in a local pool: what a trial uses, such as the host core's C, may know one lap at a time."""


@cache
def _here() -> dict[str, str]:
    return versions()


def _difference(expected: Mapping[str, str]) -> str:
    """The first package of another version than `expected`; '' if there is none."""
    for name, version in expected.items():
        found = _here().get(name, "absent")
        if found != version:
            return f"{name} {found}, this machine {version}: results would not be the same"
    return ""


def _itself(constant: bytes) -> bytes:
    return constant


@lru_cache(maxsize=1)
def _unpacked(constant: bytes) -> tuple[Callable[[Any], Any], Mapping[str, str]]:
    found: tuple[Callable[[Any], Any], Mapping[str, str]] = pickle.loads(constant)
    return found


def _carry_out(constant: bytes, job: bytes) -> Any:
    work, expected = _unpacked(constant)
    # Not only at the beginning: this worker may have come later.
    if difference := _difference(expected):
        raise CampaignError(f"a worker of the cluster has {difference}")
    with _one_at_a_time:
        return work(pickle.loads(job))
