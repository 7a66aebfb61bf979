"""Runs trials on all cores. The order of the results is that of the trials, whatever finished first."""

import multiprocessing
import os
import signal
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace

from campaigns.errors import CampaignError
from campaigns.plan import Trial
from campaigns.trial import Result, carry_out
from targets.ecus import Build

_build: Build | None = None


def run(
    trials: Sequence[Trial],
    build: Build,
    workers: int | None = None,
    done: Callable[[Result], None] | None = None,
) -> list[Result]:
    """Carry out `trials` in `workers` processes (all cores if None); done is told of each as it ends.

    Raises CampaignError if a worker was killed from outside.
    """
    count = min(workers or os.cpu_count() or 1, len(trials))
    if count <= 1:
        results = []
        for trial in trials:
            results.append(carry_out(trial, build))
            if done:
                done(results[-1])
        return results
    by_id: dict[str, Result] = {}
    with ProcessPoolExecutor(count, _context(), _start, (build,)) as pool:
        futures: list[Future[Result]] = [pool.submit(_carry_out, trial) for trial in trials]
        try:
            for future in as_completed(futures):
                result = future.result()
                by_id[result.trial.id] = result
                if done:
                    done(result)
        except BrokenProcessPool:
            left = len(trials) - len(by_id)
            raise CampaignError(f"a worker was killed, {left} of {len(trials)} trials not done") from None
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    return [by_id[trial.id] for trial in trials]


def warm_up(trial: Trial, build: Build) -> None:
    """Compile what is compiled once, so that forked workers have it and others find it on disk."""
    carry_out(replace(trial, fault="", seconds=1.0), build)


def _context() -> multiprocessing.context.BaseContext:
    methods = multiprocessing.get_all_start_methods()
    return multiprocessing.get_context("fork" if "fork" in methods else "spawn")


def _start(build: Build) -> None:
    global _build  # noqa: PLW0603  # a worker's one build, handed over once instead of with every trial
    _build = build
    # Ctrl-C reaches the whole group: the parent ends the pool, the workers say nothing of their own.
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _carry_out(trial: Trial) -> Result:
    assert _build is not None
    return carry_out(trial, _build)
