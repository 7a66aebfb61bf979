"""The training recipe as data: what is trained, in which stages, and what is reported."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from targets.errors import TrainingError
from targets.narx.prepare import RANGES, Range
from targets.narx.sequences import Sequences


@dataclass(frozen=True)
class Stage:
    """Levenberg-Marquardt iterations on one kind of error.

    closed: the parallel form (own outputs fed back), else the series-parallel form.
    horizon: after so many samples the closed loop starts anew from what was measured; None: never. A
    network that would not survive a whole ride is led there over growing horizons.
    samples: train on so many, drawn once by segments of that length; None: on all.
    """

    name: str
    closed: bool
    iterations: int
    horizon: int | None = None
    samples: int | None = None

    def __post_init__(self) -> None:
        for name, value in (
            ("iterations", self.iterations),
            ("horizon", self.horizon),
            ("samples", self.samples),
        ):
            if value is not None and value < 1:
                raise TrainingError(f"stage {self.name}: {name} is {value}, at least 1 is needed")


SCREENING = (
    Stage("series-parallel", closed=False, iterations=100, horizon=1000, samples=60_000),
    Stage("parallel, 0.2 s", closed=True, iterations=10, horizon=20, samples=60_000),
    Stage("parallel, 10 s", closed=True, iterations=30, horizon=1000, samples=60_000),
)
"""What every seed goes through."""

REFINEMENT = (Stage("parallel", closed=True, iterations=80),)
"""What the best seed goes through after that."""

SERIES_PARALLEL = (Stage("series-parallel", closed=False, iterations=1000, horizon=1000),)
"""Section III.1 to the letter: the closed loop is first tried when training has ended."""

FROM_LINEAR = (Stage("parallel, from linear", closed=True, iterations=60, horizon=1000),)
"""From the best linear filter of the inputs, which a network contains."""

RECIPES: dict[str, dict[str, Any]] = {
    "parallel": {"screening": SCREENING, "refinement": REFINEMENT},
    "series-parallel": {"screening": SERIES_PARALLEL, "refinement": ()},
    "linear": {"screening": FROM_LINEAR, "refinement": (), "linear_start": True},
}
"""Recipe -> the stages of `Settings`."""


def recipe_of(name: str) -> dict[str, Any]:
    """The stages of a recipe by its name, as arguments of `Settings`; TrainingError for another name."""
    if name not in RECIPES:
        raise TrainingError(f"unknown recipe {name!r}; the known ones are {', '.join(RECIPES)}")
    return dict(RECIPES[name])


def relative_suits(data: Sequences, span: Range) -> bool:
    """Whether errors of data's output can be divided by it: hardly a sample within a tenth of its span of 0.

    A motorcycle's rear stroke keeps off its end stop; a bicycle's shock rests on it, and there a relative
    error says nothing.
    """
    measured = np.concatenate([np.abs(y) for _, y in data.runs])
    return bool(np.quantile(measured, 0.01) > 0.1 * max(abs(span[0]), abs(span[1])))


@dataclass(frozen=True)
class Settings:
    """How to train; the defaults are N = 15, d = 10 of section III.1 and the recipe that did best.

    delays, shift, washout: samples; the first `washout` of a run are not counted, the loop starts there.
    seeds: one network each goes through `screening`, the best through `refinement`.
    relative: errors are divided by the measured output, as Er divides them (eq. III.2), or by `floor`
    where it is less; else plain squared errors, for outputs that pass through 0. Er or RMSE then judges.
    On simulated laps the two differ by less than seeds do; the default is the one Er is made of.
    decay: weight of |theta|^2 beside the mean squared error; three times more or less raised Er.
    held_out: share of the runs that end a stage, by their one-step error in the series-parallel form and
    by their free run in the parallel form, and by the latter choose the seed.
    patience: iterations of a stage without a better judgement before it ends.
    linear_start: the first neuron begins as the linear filter of the inputs that fits best, the others
    silent; else all weights are random.
    initial: what the fed-back delay line starts from; None: the median of the output.
    edit: apply `prepare.edited` to every channel first.
    device: where matrices are multiplied, "cpu" or "cuda". single: their blocks in float32.
    Raises TrainingError for a value out of range.
    """

    neurons: int = 15
    delays: int = 10
    shift: int = 0
    washout: int = 100
    seeds: tuple[int, ...] = (0, 1, 2)
    screening: tuple[Stage, ...] = SCREENING
    refinement: tuple[Stage, ...] = REFINEMENT
    relative: bool = True
    floor: float = 1.0
    decay: float = 1e-7
    held_out: float = 0.15
    patience: int = 20
    initial: float | None = None
    edit: bool = False
    linear_start: bool = False
    ranges: Mapping[str, Range] = field(default_factory=lambda: dict(RANGES))
    device: str = "cpu"
    single: bool = True

    def __post_init__(self) -> None:
        least = {"neurons": 1, "delays": 1, "shift": 0, "washout": 0, "patience": 1, "decay": 0.0}
        for name, bound in least.items():
            if not getattr(self, name) >= bound:
                raise TrainingError(f"{name} is {getattr(self, name)}, at least {bound} is needed")
        if not 0.0 < self.held_out < 1.0:
            raise TrainingError(f"held_out is {self.held_out}, a share between 0 and 1 is needed")
        if not self.floor > 0.0:
            raise TrainingError(f"floor is {self.floor}, more than 0 is needed")
        if not self.seeds or not self.screening:
            raise TrainingError("a seed and a screening stage are needed")
        if min(self.seeds) < 0:
            raise TrainingError(f"seed {min(self.seeds)} is negative")
