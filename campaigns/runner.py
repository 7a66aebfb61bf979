"""Runs trials on all cores. The order of the results is that of the trials, whatever finished first."""

import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

from bench import pool
from campaigns.plan import Trial
from campaigns.trial import Result, carry_out
from targets.ecus import Build


def run(
    trials: Sequence[Trial],
    build: Build,
    workers: int | None = None,
    done: Callable[[Result], None] | None = None,
) -> list[Result]:
    """Carry out `trials` in `workers` processes (all cores if None); done is told of each, in their order.

    Raises BenchError if a worker was killed from outside.
    """
    results = []
    for result in pool.results(partial(carry_out, build=build), trials, workers or os.cpu_count() or 1):
        results.append(result)
        if done:
            done(result)
    return results


def warm_up(trial: Trial, build: Build) -> None:
    """Compile what is compiled once, so that forked workers have it and others find it on disk."""
    carry_out(replace(trial, fault="", seconds=1.0), build)
