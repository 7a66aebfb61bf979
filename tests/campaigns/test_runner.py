"""Running a campaign: the same figures again, whatever the number of workers."""

import multiprocessing
import os

import pytest

from bench.errors import BenchError, RouteError
from bench.verdict import Outcome
from campaigns import runner
from campaigns.plan import Campaign, Trial, expand
from campaigns.runner import run, warm_up
from targets.ecus import build

FORKS = "fork" in multiprocessing.get_all_start_methods()


@pytest.fixture(scope="module")
def ecu():
    return build("ifd", "mcu")


@pytest.fixture(scope="module")
def trials():
    campaign = Campaign(
        title="Short",
        stands_for="nothing",
        route="mixed_5km",
        laps=1,
        seed=20_000,
        seconds=4,
        fault_window_s=(2.5, 3),
        faults={"open": "rear_stroke:open"},
    )
    return expand(campaign)


@pytest.fixture(scope="module")
def results(trials, ecu):
    return run(trials, ecu, 1)


def test_results(trials, results):
    """Each trial is ridden to its length and its steps are counted in cycles of the MCU's clock."""
    assert [result.trial for result in results] == trials
    for result in results:
        assert (result.ridden_ns, result.steps, result.hz) == (4_010_000_000, 400, 22_000_000)
        assert 3_000 < result.least <= result.cycles / result.steps <= result.most < 8_000
        assert result.least**2 * 400 <= result.squares <= result.most**2 * 400
        assert 0.05 < result.bus_load < 0.15
    assert Outcome.INVALID not in {result.outcome for result in results}


def test_again(trials, ecu, results):
    """The same campaign again gives equal results."""
    assert run(trials, ecu, 1) == results


def test_workers(trials, ecu, results):
    """Two workers give what one gives, in the order of the trials, and tell of each in it."""
    told = []
    assert run(trials, ecu, 2, told.append) == results
    assert told == results


def test_more_workers_than_trials(trials, ecu, results):
    """One trial is carried out in this process, however many workers are allowed."""
    told = []
    assert run(trials[:1], ecu, 8, told.append) == results[:1] == told


def test_no_trials(ecu):
    """No trial, no result."""
    assert run([], ecu) == []


def test_warm_up(trials, ecu, monkeypatch):
    """Warming up rides one second without the fault."""
    ridden = []
    monkeypatch.setattr(runner, "carry_out", lambda trial, build: ridden.append(trial))
    warm_up(trials[1], ecu)
    assert ridden == [Trial("open", "mixed_5km", "gsxr1000", "datasheet", 20_001, "", 1.0)]


@pytest.mark.parametrize("workers", [1, 2])
def test_refusal_in_a_worker(trials, ecu, workers):
    """What a trial is refused for reaches the caller in the same words from any process."""
    nowhere = [Trial("open", "nordschleife", "gsxr1000", "ideal", seed, "") for seed in (1, 2)]
    with pytest.raises(RouteError, match="unknown route 'nordschleife'"):
        run(nowhere, ecu, workers)


@pytest.mark.skipif(not FORKS, reason="workers that are not forked do not inherit the stand-in")
def test_killed_worker(trials, ecu, monkeypatch):
    """A worker killed from outside ends the campaign with how much was left."""
    monkeypatch.setattr(runner, "carry_out", lambda *_, **__: os._exit(9))
    with pytest.raises(BenchError, match="a worker was killed; 0 of 2 jobs are done"):
        run(trials, ecu, 2)
