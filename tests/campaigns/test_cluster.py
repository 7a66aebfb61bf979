"""Trials on a real Dask cluster: a scheduler and workers in processes of their own, and how they are lost."""

import logging
import os
import re
import signal
import socket
import sys
import time
from contextlib import ExitStack
from functools import partial

import pytest

from bench.errors import LapError
from campaigns import cluster as module
from campaigns.cluster import AHEAD, Cluster
from campaigns.errors import CampaignError
from campaigns.runner import Local, Ran, run
from campaigns.store import Store
from tests.campaigns import dask_cluster, trifles
from tests.campaigns.trifles import CAMPAIGN, Trifle, begun, logged, quick

cloudpickle = pytest.importorskip("cloudpickle")
pytest.importorskip("distributed")
COUNT = 30


@pytest.fixture(scope="module", autouse=True)
def by_value():
    """The workers need not have the tests' modules."""
    modules = (trifles, sys.modules[__name__])
    for one in modules:
        cloudpickle.register_pickle_by_value(one)
    yield
    for one in modules:
        cloudpickle.unregister_pickle_by_value(one)


class Clusters:
    """A cluster of two workers, and another one where those of the first do not come back."""

    def __init__(self):
        self._stack, self._address = ExitStack(), None

    def address(self):
        from distributed import Client

        if self._address:
            with Client(self._address, set_as_default=False) as client:
                try:
                    client.wait_for_workers(2, timeout=5)
                except TimeoutError:  # a worker killed while it still is being started is not started again
                    self.close()
        if not self._address:
            _, self._address = self._stack.enter_context(dask_cluster.cluster(2))
        return self._address

    def close(self):
        self._stack.close()
        self._address = None


@pytest.fixture(scope="module")
def clusters():
    clusters = Clusters()
    yield clusters
    clusters.close()


@pytest.fixture
def two(clusters):
    """A LocalCluster's scheduler with two worker processes."""
    return clusters.address()


@pytest.fixture(scope="module")
def expected(tmp_path_factory):
    """The content hash that one process leaves."""
    path = tmp_path_factory.mktemp("local") / "store"
    with Store.open(path, CAMPAIGN) as store:
        run(trifles.trifles(COUNT), quick, store, Local(1))
        return store.content_hash()


@pytest.fixture
def silent():
    """Nothing of what Dask has to say is heard."""
    heard = []
    handler = logging.Handler()
    handler.emit = lambda record: heard.append(record.getMessage())
    loggers = [
        logging.getLogger(name) for name in ("distributed", "distributed.client", "tornado", "asyncio")
    ]
    for logger in loggers:
        logger.addHandler(handler)
    yield
    for logger in loggers:
        logger.removeHandler(handler)
    assert heard == []


@pytest.fixture
def store(tmp_path):
    with Store.open(tmp_path / "store", CAMPAIGN) as store:
        yield store


def refused(cluster, store, work=quick):
    """The one line with which a run on it is refused, after the cluster's address."""
    with pytest.raises(CampaignError) as refusal:
        run(trifles.trifles(COUNT), work, store, cluster)
    line = str(refusal.value)
    assert line.startswith(f"cluster {cluster.url}: ")
    assert "\n" not in line
    return line.removeprefix(f"cluster {cluster.url}: ")


def slow(trifle):
    time.sleep(0.05)
    return quick(trifle)


def pid(trifle):
    time.sleep(0.01)
    return {"pid": os.getpid()}, None


def kills_once(trifle, mark):
    """The 7th kills its worker the first time."""
    if trifle.n == 7 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return slow(trifle)


def kills(trifle):
    if trifle.n == 7:
        time.sleep(0.5)
        os.kill(os.getpid(), signal.SIGKILL)
    return quick(trifle)


def refuses_7(trifle):
    if trifle.n == 7:
        raise LapError("lap 7 is bad")
    return quick(trifle)


def alone(trifle, folder):
    """Fails if another one runs in this process."""
    mark = folder / str(os.getpid())
    mark.touch(exist_ok=False)
    time.sleep(0.01)
    mark.unlink()
    return quick(trifle)


class Pickled:
    """Work that counts how often it is pickled."""

    count = 0

    def __reduce__(self):
        Pickled.count += 1
        return partial, (quick,)


class Counted(list):
    """Jobs, and the most that were handed out and not yet back."""

    back = most = 0

    def __getitem__(self, k):
        self.most = max(self.most, k + 1 - self.back)
        return super().__getitem__(k)


def test_same_store(two, store, expected):
    """A cluster of two workers leaves the store that one process leaves."""
    told = []
    ran = run(trifles.trifles(COUNT), quick, store, Cluster(two), lambda *what: told.append(what[:2]))
    assert ran == Ran(COUNT, 0, COUNT)
    assert store.content_hash() == expected
    assert told == [(k, COUNT) for k in range(1, COUNT + 1)]


def test_both_workers(two, store):
    """The trials are shared among the workers, none is run here."""
    run(trifles.trifles(COUNT), pid, store, Cluster(two))
    pids = {row.result["pid"] for row in store.rows()}
    assert len(pids) == 2
    assert os.getpid() not in pids


def test_handed_out(two):
    """No more trials are on their way than keep the workers busy."""
    jobs = Counted(trifles.trifles(40))
    for _ in Cluster(two).as_completed(quick, jobs, lambda: False):
        jobs.back += 1
    assert jobs.back == 40
    assert 2 <= jobs.most <= 2 * AHEAD


def test_sent_once(two):
    """The work, with all it carries, is pickled once for all trials."""
    Pickled.count = 0
    assert len(list(Cluster(two).as_completed(Pickled(), trifles.trifles(20), lambda: False))) == 20
    assert Pickled.count == 1


def test_stop(two):
    """Once asked to stop no trial is handed out; those that are come back."""
    found = []
    for result in Cluster(two).as_completed(quick, trifles.trifles(50), lambda: len(found) >= 5):
        found.append(result)
    assert 5 <= len(found) <= 5 + 2 * AHEAD


def test_refused_trial(two, store):
    """What a trial is refused for arrives in the same words; what else was on its way is stored."""
    with pytest.raises(LapError, match="lap 7 is bad"):
        run(trifles.trifles(COUNT), refuses_7, store, Cluster(two))
    assert {trifle.id for trifle in trifles.trifles(7)} <= store.ids()


def test_killed_worker(two, store, expected, tmp_path, silent):
    """The trial of a worker that was killed is run by another one; nobody notices."""
    work = partial(kills_once, mark=tmp_path / "mark")
    assert run(trifles.trifles(COUNT), work, store, Cluster(two)).left == 0
    assert (tmp_path / "mark").exists()
    assert store.content_hash() == expected


def test_stored_is_not_run_again(two, store, tmp_path):
    """Where a worker is killed, what it had run before is stored and not run a second time."""
    log = tmp_path / "log"

    stored, lines = set(), []

    def kill(done, *_):
        if done == 8:
            stored.update(store.ids())
        if done == 20:  # the scheduler has heard of those 8 by now
            os.kill(begun(log)[-1][1], signal.SIGKILL)
            lines.append(len(begun(log)))

    work = partial(logged, work=slow, log=str(log))
    assert run(trifles.trifles(COUNT), work, store, Cluster(two), kill).left == 0
    assert not stored & {id for id, _ in begun(log)[lines[0] :]}


def test_trial_that_kills(two, store):
    """A trial that kills one worker after the other ends the run; the others are stored."""
    line = refused(Cluster(two, patience_s=5.0), store, kills)
    # the second where one was killed before it was wholly there, and is not started again
    reason = r"one worker after the other was killed at trial \w{16} or one beside it|its last worker is gone"
    progress = f"{len(store.ids())} of {COUNT} trials are stored, resume runs the rest"
    assert re.fullmatch(f"({reason}); {progress}", line)
    assert Trifle(7).id not in store.ids()


def test_scheduler_gone(store, expected, silent):
    """Where the scheduler goes away half-way, what is finished is stored, and a resume runs the rest."""
    every = trifles.trifles(COUNT)
    with dask_cluster.cluster(2) as (process, address), pytest.raises(CampaignError) as refusal:
        run(every, slow, store, Cluster(address), lambda done, *_: process.kill() if done == 10 else None)
    count = len(store.ids())
    assert 10 <= count < COUNT
    progress = f"{count} of {COUNT} trials are stored, resume runs the rest"
    assert str(refusal.value) == f"cluster {address}: the scheduler is gone; {progress}"
    assert run(every, quick, store, Local(1)) == Ran(COUNT, count, COUNT - count)
    assert store.content_hash() == expected


def test_mortal_workers(store, tmp_path):
    """A worker of two threads carries out one trial at a time; where the last worker goes away it is said."""
    pids = tmp_path / "pids"

    def kill(done, *_):
        for pid in pids.read_text().split() if done == 5 else ():
            os.kill(int(pid), signal.SIGKILL)

    (tmp_path / "alone").mkdir()
    with dask_cluster.cluster(2, pids) as (_, address):
        jobs, work = trifles.trifles(20), partial(alone, folder=tmp_path / "alone")
        assert len(list(Cluster(address).as_completed(work, jobs, lambda: False))) == 20
        with pytest.raises(CampaignError, match=r"its last worker is gone; \d+ of 400 trials are stored"):
            run(trifles.trifles(400), slow, store, Cluster(address, patience_s=1.0), kill)
    assert 5 <= len(store.ids()) < 400


def test_other_version(store, tmp_path):
    """A worker with another version of the software is refused, with both versions, before any trial."""
    info = tmp_path / "strokebench-9.9.9.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: strokebench\nVersion: 9.9.9\n")
    here = module.versions()["strokebench"]
    with dask_cluster.cluster(1, path=[tmp_path]) as (_, address):
        line = refused(Cluster(address), store)
    assert line.startswith("worker tcp://127.0.0.1:")
    assert line.endswith(f"has strokebench 9.9.9, this machine {here}: results would not be the same")
    assert store.ids() == set()


def test_late_worker(monkeypatch):
    """A worker that came after the check compares its software with the first trial it gets."""
    monkeypatch.setattr(module, "_here", lambda: {"strokebench": "9.9.9"})
    constant = cloudpickle.dumps((quick, {"strokebench": "1.0"}))
    with pytest.raises(CampaignError, match=r"a worker of the cluster has strokebench 9.9.9, .* 1.0"):
        module._carry_out(constant, cloudpickle.dumps(Trifle(1)))


def test_no_workers(store):
    """A scheduler without workers is refused."""
    with dask_cluster.cluster(0) as (_, address):
        assert refused(Cluster(address, connect_s=3.0), store) == "has no workers"


@pytest.mark.parametrize("url", ["", "10.0.0.1:8786", "http://x:1", "tcp://x", "tcp://x:1/y", "tcp:// :1"])
def test_no_address(store, url):
    """What is no address is refused with one that is."""
    assert refused(Cluster(url), store) == "is no address; one looks like tcp://10.0.0.1:8786"


def test_nobody_there(store, silent):
    """Where nobody answers it is refused after a short while."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))  # and does not listen
        url = f"tcp://127.0.0.1:{taken.getsockname()[1]}"
        assert refused(Cluster(url, connect_s=0.5), store) == "no scheduler answers within 0.5 s"


def test_not_installed(store, monkeypatch):
    """Without the package that it takes, the command that installs it is told."""
    monkeypatch.setitem(sys.modules, "distributed", None)
    line = refused(Cluster("tcp://127.0.0.1:1"), store)
    assert line == "needs the package distributed: pip install 'strokebench[cluster]'"


def test_nothing_to_do(store):
    """A campaign that is complete needs no cluster."""
    run(trifles.trifles(3), quick, store, Local(1))
    assert run(trifles.trifles(3), quick, store, Cluster("tcp://127.0.0.1:1")) == Ran(3, 3, 0)
