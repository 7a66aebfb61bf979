"""Training data: named channels in plain arrays, checked once.

Belongs here: what a data set is and what makes one unfit to train on. Never: a lap, a file format.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from targets.errors import TrainingError

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Sequences:
    """Rides without a gap in time; the network's recursion starts anew in each.

    inputs, output: channel names with their units. runs: (u (T, n_u), y (T,)) each, physical units,
    columns in the order of `inputs`, sampled at rate_hz; they may differ in T.
    Raises TrainingError for no run, another number of columns, unequal lengths, NaN, or a channel that
    never moves: the network could learn nothing from it.
    """

    inputs: tuple[str, ...]
    output: str
    runs: tuple[tuple[Floats, Floats], ...]
    rate_hz: float = 100.0

    def __post_init__(self) -> None:
        if not self.inputs or self.output in self.inputs or len(set(self.inputs)) < len(self.inputs):
            raise TrainingError(
                f"inputs {', '.join(self.inputs) or '(none)'} for {self.output}: not distinct"
            )
        if not self.rate_hz > 0:
            raise TrainingError(f"sampling rate {self.rate_hz} Hz")
        if not self.runs:
            raise TrainingError("no sequence to train on")
        runs = tuple(self._checked(k, *run) for k, run in enumerate(self.runs))
        for j, name in enumerate((*self.inputs, self.output)):
            columns = [u[:, j] if j < len(self.inputs) else y for u, y in runs]
            lo, hi = min(c.min() for c in columns), max(c.max() for c in columns)
            if lo == hi:
                raise TrainingError(f"{name} is {lo:g} in every sample: nothing can be learned from it")
        object.__setattr__(self, "runs", runs)

    def _checked(self, k: int, u: Floats, y: Floats) -> tuple[Floats, Floats]:
        u, y = np.asarray(u, dtype=np.float64), np.asarray(y, dtype=np.float64)
        if u.ndim != 2 or u.shape[1] != len(self.inputs):
            columns = u.shape[1] if u.ndim == 2 else 0
            raise TrainingError(
                f"sequence {k} has {columns} input channels, {len(self.inputs)} are named: "
                f"{', '.join(self.inputs)}"
            )
        if y.shape != u.shape[:1] or not y.size:
            raise TrainingError(f"sequence {k} has {y.size} samples of {self.output}, {len(u)} of its inputs")
        for name, column in zip((*self.inputs, self.output), (*u.T, y), strict=True):
            bad = np.flatnonzero(~np.isfinite(column))
            if bad.size:
                raise TrainingError(f"sequence {k}: {name} is {column[bad[0]]} at sample {bad[0]}")
        return u, y

    @property
    def samples(self) -> int:
        """How many samples there are in all runs."""
        return sum(len(y) for _, y in self.runs)
