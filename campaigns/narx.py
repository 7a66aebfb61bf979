"""Runs the soft sensors' campaigns: many networks, each in a process with one thread of its own.

Belongs here: which networks are trained on what. Never: a table, a screen, how a network is trained.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from bench import pool
from bench.laps.lap import Lap
from bench.plant.motorcycle import load_motorcycle
from bench.sensors.datasheets import load_sensors
from campaigns.fields import Laps
from campaigns.laps import Simulated
from campaigns.narx_plan import NarxGrid, NarxLeaveOneOut, NarxPerformance
from campaigns.soft_sensor import (
    WASHOUT,
    Predictor,
    baselines,
    inputs_of,
    linear,
    network,
    pairs,
    ranges,
    sequences,
)
from campaigns.store import Document, Identified
from targets.errors import TrainingError
from targets.narx import measures
from targets.narx.network import Narx
from targets.narx.sequences import Sequences
from targets.narx.settings import Settings, recipe_of, relative_suits
from targets.narx.train import train

Tell = Callable[[str], None]


def ridden(laps: Laps) -> list[Lap]:
    """The simulated laps of a plan."""
    seeds = range(laps.seed, laps.seed + laps.count)
    return [Simulated(laps.route, laps.motorcycle, seed).ridden() for seed in seeds]


@dataclass(frozen=True)
class Cell:
    """One network of the grid: what it is, and its Er in percent on training and test laps.

    An Er of infinity is a free run that diverged, on any lap: such a network does not pass.
    """

    neurons: int
    delays: int
    seed: int
    training_percent: float
    test_percent: float

    def passes(self, percent: float) -> bool:
        """Whether it is accepted as Table III.2 accepts."""
        return max(self.training_percent, self.test_percent) < percent


@dataclass(frozen=True)
class GridTrial(Identified):
    """One network of the grid. shared: what all of them have in common, part of each one's identity."""

    neurons: int
    delays: int
    seed: int
    shared: Document = field(repr=False, compare=False)

    def document(self) -> Document:
        """See `Identified`."""
        which = {"neurons": self.neurons, "delays": self.delays, "seed": self.seed}
        return {"kind": "narx_grid", **which, **self.shared}


def grid_trials(plan: NarxGrid) -> list[GridTrial]:
    """Every network of the grid: the whole table for one seed after the other."""
    shared = plan.model_dump(
        mode="json", include={"training", "test", "sensors", "recipe", "samples", "iterations"}
    )
    return [GridTrial(n, d, seed, shared) for seed in plan.seeds for n in plan.neurons for d in plan.delays]


@dataclass(frozen=True, eq=False)
class GridWork:
    """Trains the networks of a grid, in whatever process."""

    plan: NarxGrid
    training: Sequences
    test: Sequences

    def __call__(self, trial: GridTrial) -> tuple[Document, None]:
        """The trial's `Cell` as a document, null for infinity."""
        cell = _cell(trial, self.plan, self.training, self.test)
        figures = {"training_percent": cell.training_percent, "test_percent": cell.test_percent}
        return {name: value if np.isfinite(value) else None for name, value in figures.items()}, None


def grid_work(plan: NarxGrid) -> GridWork:
    """Ride the plan's laps."""
    sensors = load_sensors(plan.sensors)
    return GridWork(plan, *(sequences(ridden(laps), sensors) for laps in (plan.training, plan.test)))


def grid_cells(plan: NarxGrid, rows: Iterable[tuple[Document, Document]]) -> list[Cell]:
    """The networks that are trained, in the order of the table; rows: trials' documents and results."""
    known = {(row["neurons"], row["delays"], row["seed"]): result for row, result in rows}
    found = []
    for trial in grid_trials(plan):
        which = trial.neurons, trial.delays, trial.seed
        if which in known:
            figures = (known[which][name] for name in ("training_percent", "test_percent"))
            found.append(Cell(*which, *(np.inf if value is None else value for value in figures)))
    return found


def _cell(trial: GridTrial, plan: NarxGrid, training: Sequences, test: Sequences) -> Cell:
    import torch

    torch.set_num_threads(1)  # as many networks as cores: more threads would only wait for each other
    neurons, delays, seed = trial.neurons, trial.delays, trial.seed
    stages = recipe_of(plan.recipe)["screening"]
    settings = Settings(
        neurons=neurons,
        delays=delays,
        seeds=(seed,),
        screening=tuple(
            replace(stage, samples=plan.samples, iterations=min(stage.iterations, plan.iterations))
            for stage in stages
        ),
        refinement=(),
    )
    try:
        found = train(training, settings).network.rounded()
    except TrainingError:  # its free run diverges
        return Cell(neurons, delays, seed, np.inf, np.inf)
    return Cell(neurons, delays, seed, _er(found, training), _er(found, test))


def _er(narx: Narx, data: Sequences) -> float:
    runs = pairs(network("", narx, data), data)
    predicted, measured = (
        np.concatenate([values[WASHOUT:] for values in column]) for column in zip(*runs, strict=True)
    )
    error = measures.relative_error(predicted, measured)
    return error if np.isfinite(error) else float("inf")


@dataclass(frozen=True)
class Measured:
    """Predictors on runs, and where the runs are from."""

    predictors: tuple[Predictor, ...]
    data: Sequences
    sources: tuple[str, ...]


def performance(plan: NarxPerformance, narx: Narx, test: Sequence[Lap] | None, tell: Tell) -> Measured:
    """`narx` on unseen laps, the plan's or `test`, beside the half-car sensor and the best constant."""
    sensors, machine = load_sensors(plan.sensors), load_motorcycle(plan.training.motorcycle)
    inputs = tuple(dict.fromkeys((*narx.inputs, "fork_stroke_mm", "pitch_rate_dps")))
    for lap in test or ():
        lap.require((*inputs, narx.output), "the soft sensors compared")
    tell("riding the training laps")
    training = sequences(ridden(plan.training), sensors, inputs)
    tell("riding the test laps")
    laps = list(test) if test else ridden(plan.test)
    data = sequences(laps, sensors, inputs)
    own = replace(
        data,
        inputs=narx.inputs,
        runs=tuple((u[:, [inputs.index(name) for name in narx.inputs]], y) for u, y in data.runs),
    )
    predictors = (network("NARX network", narx, own), *baselines(training, data, machine))
    return Measured(predictors, data, tuple(lap.source for lap in laps))


def leave_one_out(
    plan: NarxLeaveOneOut, laps: Sequence[Lap], sensors_name: str, workers: int, tell: Tell
) -> Measured:
    """Every lap predicted by a network trained on all others, and by a linear filter fitted to them."""
    if len(laps) < 3:
        raise TrainingError(f"leave one out takes at least 3 laps, there are {len(laps)}")
    data = sequences(laps, load_sensors(sensors_name), inputs_of(laps, None))
    work = partial(_left_out, plan=plan, data=data)
    folds = []
    for k, fold in enumerate(pool.results(work, range(len(laps)), workers)):
        folds.append(fold)
        tell(f"{laps[k].source} left out")
    joined = tuple(
        Predictor(parts[0].name, tuple(part.predictions[0] for part in parts))
        for parts in zip(*folds, strict=True)
    )
    return Measured(joined, data, tuple(lap.source for lap in laps))


def _left_out(k: int, plan: NarxLeaveOneOut, data: Sequences) -> list[Predictor]:
    import torch

    torch.set_num_threads(1)
    others = replace(data, runs=(*data.runs[:k], *data.runs[k + 1 :]))
    one = _one(data, k)
    every = ranges()
    settings: dict[str, Any] = recipe_of(plan.recipe)
    narx = train(
        others,
        Settings(
            neurons=plan.neurons,
            delays=plan.delays,
            seeds=tuple(plan.seeds),
            ranges=every,
            relative=relative_suits(others, every[data.output]),
            **settings,
        ),
    ).network
    return [
        network(f"NARX network, N = {plan.neurons}, d = {plan.delays}", narx, one),
        linear(others, one, plan.delays),
        *baselines(others, one, None),
    ]


def _one(data: Sequences, k: int) -> Sequences:
    return replace(data, runs=(data.runs[k],))
