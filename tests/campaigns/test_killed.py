"""kill -9 of a campaign's runner and of its workers: nothing finished is lost or run again."""

import os
import random
import re
import signal
import time

import pytest

from campaigns.store import Store
from tests.campaigns.trifles import CAMPAIGN, begun, start, table

COUNT, KILLS = 60, 20
ENDS_S = 30
"""An orphan that does not end by itself holds the runner's streams open for longer."""


def stored(path):
    if not path.exists() or not path.stat().st_size:
        return set()
    with Store.read(path) as store:
        return store.ids()


def contents(path):
    with Store.read(path) as store:
        return store.content_hash(), table(store)


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("undisturbed")
    assert start(folder / "store", folder / "log", 1, COUNT).wait() == 0
    return contents(folder / "store")


def killed(process, log, known, rng, victim):
    """Kill the `victim` at a moment of `rng`; whom the signal reached, None if it came too late."""
    trials = rng.randrange(5)
    if victim == "runner" and trials == 0:
        time.sleep(rng.uniform(0, 0.3))  # while it starts, opens the store, starts its workers
    else:
        while process.poll() is None and len(begun(log)) < known + max(trials, 1):
            time.sleep(0.001)
        time.sleep(rng.uniform(0, 0.02))
    if process.poll() is not None:
        return None
    workers = [pid for _, pid in begun(log)[known:]]
    pid = process.pid if victim == "runner" else rng.choice(workers)
    try:
        os.kill(pid, signal.SIGKILL)
    except ProcessLookupError:
        return None
    return "runner" if pid == process.pid else victim  # a last trial alone is the runner's own work


def test_killed_at_20_moments(undisturbed, tmp_path):
    """Resumed after each kill, a campaign ends as if nothing had been; no stored trial begins again."""
    rng, kills = random.Random(5), {"runner": 0, "worker": 0}
    folders = (tmp_path / str(k) for k in range(KILLS))
    while sum(kills.values()) < KILLS:  # as many campaigns as that takes
        folder = next(folders)
        folder.mkdir()
        path, log = folder / "store", folder / "log"
        code = None
        while code != 0:
            before, known = stored(path), len(begun(log))
            process = start(path, log, 2, COUNT)
            victim = min(kills, key=kills.get) if sum(kills.values()) < KILLS else None
            victim = victim and killed(process, log, known, rng, victim)
            _, said = process.communicate(timeout=ENDS_S)
            code, after = process.returncode, stored(path)
            if code == 0:  # the signal found a process that had nothing left to do
                victim = None
            assert not before & {id for id, _ in begun(log)[known:]}
            assert before <= after
            kills |= {victim: kills[victim] + 1} if victim else {}
            if victim == "runner":
                assert code == -signal.SIGKILL
            elif code != 0:
                expected = (
                    rf"a worker was killed; {len(after)} of {COUNT} trials are stored, resume runs the rest"
                )
                assert (victim, code) == ("worker", 2)
                assert re.fullmatch(expected, said.strip())
        assert len({id for id, _ in begun(log)}) == COUNT
        assert contents(path) == undisturbed
        assert sorted(file.name for file in folder.iterdir()) == ["log", "store"]
    assert min(kills.values()) >= 5


def test_orphans(tmp_path):
    """Workers whose runner was killed end by themselves, in the middle of a trial, and say nothing."""
    path, log = tmp_path / "store", tmp_path / "log"
    process = start(path, log, 4, 4, "endless")
    while len(begun(log)) < 4:
        time.sleep(0.01)
    process.kill()
    # the streams end with the last one that holds them
    assert process.communicate(timeout=ENDS_S) == ("", "")
    assert stored(path) == set()


def test_orphans_hold_no_lock(tmp_path):
    """A store can be gone on with while workers of its killed runner still are there."""
    path, log = tmp_path / "store", tmp_path / "log"
    process = start(path, log, 2, 2, "endless")
    while len(begun(log)) < 2:
        time.sleep(0.01)
    workers = [pid for _, pid in begun(log)]
    for pid in workers:
        os.kill(pid, signal.SIGSTOP)
    process.kill()
    process.wait()
    try:
        with Store.open(path, CAMPAIGN) as store:
            assert store.ids() == set()
    finally:
        for pid in workers:
            os.kill(pid, signal.SIGCONT)
        process.communicate(timeout=ENDS_S)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_interrupted(number, tmp_path):
    """After Ctrl-C or SIGTERM what was begun is finished and stored, and nothing else begins."""
    path, log = tmp_path / "store", tmp_path / "log"
    process = start(path, log, 2, 500)
    while len(begun(log)) < 5:
        time.sleep(0.001)
    if number == signal.SIGINT:
        os.killpg(process.pid, number)  # as the terminal does
    else:
        process.send_signal(number)
    assert process.communicate(timeout=ENDS_S) == ("", "")
    assert process.returncode == 130
    assert {id for id, _ in begun(log)} == stored(path)
    assert 5 <= len(stored(path)) < 500
