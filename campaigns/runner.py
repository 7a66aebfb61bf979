"""Carries out a campaign's trials: those that its store lacks, each stored as it ends.

Belongs here: what runs, when it stops, what is told. Never: what a trial is, where its processes come from.
"""

import signal
import threading
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

from bench import pool
from campaigns.errors import CampaignError
from campaigns.store import Document, Store

PASSED = ("CD", "OK")
"""Outcomes with which `fail_fast` goes on."""


class Job(Protocol):
    """A trial to be carried out; it travels to other processes by pickling."""

    @property
    def id(self) -> str:
        """Derived from the document; see `campaigns.store.trial_id`."""
        ...

    def document(self) -> Document:
        """All that decides the result, and nothing else."""
        ...


J = TypeVar("J", bound=Job)
Work = Callable[[J], tuple[Document, Document | None]]
"""A job's result and its freeze frame; it is sent to every worker once."""
Tell = Callable[[int, int, Document], None]
"""Called with how many trials are stored, of how many, and the result of the latest."""


class Executor(Protocol):
    """Where jobs are carried out."""

    def as_completed(
        self, work: Callable[[Any], Any], jobs: Sequence[Any], stop: Callable[[], bool]
    ) -> Generator[tuple[int, Any], None, None]:
        """(index of the job, `work` of it) as each one ends; no further one begins once `stop()`."""
        ...


@dataclass(frozen=True)
class Local:
    """Processes of this machine; this one alone if `workers` is 1."""

    workers: int

    def as_completed(
        self, work: Callable[[Any], Any], jobs: Sequence[Any], stop: Callable[[], bool]
    ) -> Generator[tuple[int, Any], None, None]:
        """See `bench.pool.as_completed`."""
        return pool.as_completed(work, jobs, self.workers, stop)


@dataclass(frozen=True)
class Ran:
    """How a run ended: trials of the campaign, those stored before it and those it added.

    failed: id of the first trial that did not pass, where that ended the run.
    """

    total: int
    before: int
    added: int
    failed: str | None = None

    @property
    def left(self) -> int:
        """How many trials of the campaign the store still lacks."""
        return self.total - self.before - self.added


def run(
    jobs: Sequence[J],
    work: Work[J],
    store: Store,
    executor: Executor,
    tell: Tell = lambda *_: None,
    fail_fast: bool = False,
) -> Ran:
    """Carry out the jobs that `store` lacks, and put each into it as it ends.

    fail_fast: none begins after the first result that did not pass; those that run then are finished and
    stored. So they are after Ctrl-C or SIGTERM, before KeyboardInterrupt is raised; a second raises at once.
    Raises CampaignError if a worker was lost; what is finished is stored then, too.
    """
    every = {job.id: job for job in jobs}  # equal trials are one
    stored = store.ids()
    missing = [job for id, job in every.items() if id not in stored]
    before, added = len(every) - len(missing), 0
    failed: str | None = None
    with _interruptible() as interrupted:
        results = executor.as_completed(work, missing, lambda: failed is not None or interrupted())
        try:
            with closing(results):
                for k, (result, frame) in results:
                    job = missing[k]
                    store.put(job.id, job.document(), result, frame)
                    added += 1
                    if fail_fast and failed is None and _fails(result):
                        failed = job.id
                    tell(before + added, len(every), result)
        except pool.WorkersLost as problem:
            progress = f"{before + added} of {len(every)} trials are stored"
            raise CampaignError(f"{problem.reason}; {progress}, resume runs the rest") from None
        if interrupted() and added < len(missing):
            raise KeyboardInterrupt
    return Ran(len(every), before, added, failed)


def _fails(result: Mapping[str, Any]) -> bool:
    return "outcome" in result and result["outcome"] not in PASSED


@contextmanager
def _interruptible() -> Iterator[Callable[[], bool]]:
    """Within the block the first SIGINT or SIGTERM is only noted, and the next one raises as ever.

    Raised wherever the program happens to be, it could lose a result between its end and its storing.
    """
    asked = False

    def note(*_: object) -> None:
        nonlocal asked
        if asked:
            raise KeyboardInterrupt
        asked = True

    before = {}
    if threading.current_thread() is threading.main_thread():  # no other one may set handlers
        for number in (signal.SIGINT, signal.SIGTERM):
            handler = signal.getsignal(number)
            if handler not in (signal.SIG_IGN, None):  # whoever started us wants it so
                before[number] = signal.signal(number, note)
    try:
        yield lambda: asked
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
