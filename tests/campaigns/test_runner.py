"""Carrying out a campaign: what runs, what is stored, when it stops, what is told."""

import os
import signal
import threading
from functools import partial

import pytest

from bench.errors import BenchError
from bench.pool import WorkersLost
from campaigns.errors import CampaignError
from campaigns.runner import Local, Ran, run
from campaigns.store import Store
from tests.campaigns.trifles import CAMPAIGN, Trifle, quick, trifles

COUNT = 20
FAILED = [n for n in range(COUNT) if quick(Trifle(n))[0]["outcome"] == "MD"]


@pytest.fixture
def store(path):
    with Store.open(path, CAMPAIGN) as store:
        yield store


class Ahead:
    """An executor with results in another order, the jobs it was given, and how many it began."""

    def __init__(self):
        self.given, self.begun = [], 0

    def as_completed(self, work, jobs, stop):
        self.given = list(jobs)
        for k in reversed(range(len(jobs))):
            if stop():
                return
            self.begun += 1
            yield k, work(jobs[k])


class Loses(Ahead):
    """One whose workers are lost after three results."""

    def as_completed(self, work, jobs, stop):
        yield from list(super().as_completed(work, jobs, stop))[:3]
        raise WorkersLost("cluster tcp://x:1: the scheduler is gone", "3 of 9 jobs are done")


def refuses_7(trifle):
    if trifle.n == 7:
        raise BenchError("trial 7 is bad")
    return quick(trifle)


def no_outcome(trifle):
    return {"cells": {}}, None


def interrupts(trifle, at, number, times=1):
    if trifle.n == at:
        for _ in range(times):
            os.kill(os.getpid(), number)
    return quick(trifle)


def test_stored(store):
    """Every trial is in the store with its document, its result and its freeze frame."""
    assert run(trifles(COUNT), quick, store, Ahead()) == Ran(COUNT, 0, COUNT)
    for trifle in trifles(COUNT):
        row = store.row(trifle.id)
        assert (row.trial, row.result, store.frame(trifle.id)) == (trifle.document(), *quick(trifle))


@pytest.mark.parametrize("workers", [1, 2, 4])
def test_workers(tmp_path, workers):
    """Any number of workers leaves the same store."""
    hashes = set()
    for name, executor in (("a", Ahead()), ("b", Local(workers))):
        with Store.open(tmp_path / name, CAMPAIGN) as store:
            assert run(trifles(COUNT), quick, store, executor).left == 0
            hashes.add(store.content_hash())
    assert len(hashes) == 1


def test_goes_on(store):
    """What is in the store is not run again; the others are, in their order."""
    run(trifles(8), quick, store, Ahead())
    executor = Ahead()
    assert run(trifles(COUNT), quick, store, executor) == Ran(COUNT, 8, COUNT - 8)
    assert executor.given == trifles(COUNT)[8:]


def test_nothing_to_do(store):
    """A campaign that is complete begins nothing."""
    run(trifles(5), quick, store, Ahead())
    executor = Ahead()
    assert run(trifles(5), quick, store, executor) == Ran(5, 5, 0)
    assert (executor.begun, run([], quick, store, executor)) == (0, Ran(0, 0, 0))


def test_equal_trials(store):
    """Equal trials are one."""
    assert run(trifles(3) * 2, quick, store, Ahead()) == Ran(3, 0, 3)


def test_told(store):
    """It is told of each trial, after it is stored: how many are, those of before too, of how many."""
    run(trifles(2), quick, store, Ahead())
    told = []
    run(trifles(5), quick, store, Ahead(), lambda *what: told.append((*what, len(store.ids()))))
    assert told == [(k, 5, quick(Trifle(7 - k))[0], k) for k in (3, 4, 5)]


def test_fail_fast(store):
    """With fail_fast nothing begins after the first trial that does not pass, and its id is returned."""
    executor = Ahead()
    ran = run(trifles(COUNT), quick, store, executor, fail_fast=True)
    assert ran == Ran(COUNT, 0, COUNT - FAILED[-1], Trifle(FAILED[-1]).id)
    assert ran.left > 0
    assert executor.begun == len(store.ids()) == ran.added


def test_fail_fast_stores_what_runs(path):
    """With fail_fast what other workers are at is stored, too."""
    with Store.open(path, CAMPAIGN) as store:
        ran = run(trifles(200), quick, store, Local(4), fail_fast=True)
        assert len(store.ids()) == ran.added < 200
        assert Trifle(FAILED[0]).id in store.ids()


def test_no_outcome(store):
    """A result without an outcome fails nothing."""
    assert run(trifles(5), no_outcome, store, Ahead(), fail_fast=True) == Ran(5, 0, 5)


def test_fail_slow(store):
    """Without fail_fast a trial that does not pass is a result like any other."""
    assert FAILED
    assert run(trifles(COUNT), quick, store, Ahead()).failed is None


@pytest.mark.parametrize("workers", [1, 3])
def test_refused_trial(store, workers):
    """What a trial is refused for reaches the caller in the same words; what was finished is stored."""
    with pytest.raises(BenchError, match="trial 7 is bad"):
        run(trifles(COUNT), refuses_7, store, Local(workers))
    assert {trifle.id for trifle in trifles(7)} <= store.ids()


def test_workers_lost(store):
    """Where workers are lost the refusal says how many trials of the campaign are stored."""
    run(trifles(2), quick, store, Ahead())
    with pytest.raises(CampaignError) as refusal:
        run(trifles(9), quick, store, Loses())
    assert str(refusal.value) == (
        "cluster tcp://x:1: the scheduler is gone; 5 of 9 trials are stored, resume runs the rest"
    )
    assert len(store.ids()) == 5


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_interrupted(store, number):
    """After the first Ctrl-C or SIGTERM the trial that runs is stored, no other begins."""
    with pytest.raises(KeyboardInterrupt):
        run(trifles(9), partial(interrupts, at=3, number=number), store, Local(1))
    assert len(store.ids()) == 4


def test_interrupted_twice(store):
    """A second Ctrl-C does not wait for the trial that runs."""
    with pytest.raises(KeyboardInterrupt):
        run(trifles(9), partial(interrupts, at=3, number=signal.SIGINT, times=2), store, Local(1))
    assert len(store.ids()) == 3


def test_interrupted_at_the_end(store):
    """Ctrl-C during the last trial interrupts nothing any more."""
    assert run(trifles(4), partial(interrupts, at=3, number=signal.SIGINT), store, Local(1)).left == 0


def test_handlers(store):
    """However a run ends, the signals' handlers are those of before; one that is ignored stays so."""
    before = signal.signal(signal.SIGTERM, signal.SIG_IGN)
    try:
        handlers = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
        with pytest.raises(KeyboardInterrupt):
            run(trifles(4), partial(interrupts, at=1, number=signal.SIGINT), store, Local(1))
        run(trifles(4), partial(interrupts, at=2, number=signal.SIGTERM), store, Local(1))
        assert [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)] == handlers
    finally:
        signal.signal(signal.SIGTERM, before)


def test_other_thread(path):
    """A run in another thread, where no handlers can be set, runs as well."""
    ran = []

    def target():
        with Store.open(path, CAMPAIGN) as store:
            ran.append(run(trifles(3), quick, store, Local(1)))

    thread = threading.Thread(target=target)
    thread.start()
    thread.join()
    assert ran == [Ran(3, 0, 3)]
