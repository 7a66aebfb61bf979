"""Training data made ready: shifted, split into what trains and what judges, weighted, normalised.

Belongs here: what happens to the channels between `Sequences` and the optimiser. Never: an iteration.
"""

import numpy as np
from numpy.typing import NDArray

from targets.errors import TrainingError
from targets.narx.objective import Segments, cut
from targets.narx.prepare import edited, normalised, shifted
from targets.narx.sequences import Sequences
from targets.narx.settings import Settings

Floats = NDArray[np.float64]
Run = tuple[Floats, Floats]


class Ready:
    """`data` as `settings` want it.

    training, held_out: runs (u (T, n_u), y (T,)), physical units, y shifted. edited: share of samples
    replaced by channel, empty if editing is off. initial: what the fed-back delay line starts from.
    Raises TrainingError for a channel without a range and for too few samples.
    """

    def __init__(self, data: Sequences, settings: Settings) -> None:
        self.names, self.settings = (*data.inputs, data.output), settings
        for name in self.names:
            if name not in settings.ranges:
                raise TrainingError(
                    f"no range to normalise {name} by; there are {', '.join(settings.ranges)}"
                )
        self.edited: dict[str, float] = {}
        runs = self._edit(data.runs) if settings.edit else data.runs
        least = settings.washout + settings.delays + 1
        for k, (_, y) in enumerate(runs):
            if len(y) < least + settings.shift:
                raise TrainingError(
                    f"sequence {k} has {len(y)} samples; washout {settings.washout}, delays "
                    f"{settings.delays} and shift {settings.shift} leave none to train on"
                )
        self.training, self.held_out = _split(
            [shifted(u, y, settings.shift) for u, y in runs], settings.held_out, least
        )
        weights = settings.neurons * ((len(data.inputs) + 1) * settings.delays + 2) + 1
        self.samples = sum(len(y) - settings.washout for _, y in self.training)
        if self.samples < weights:
            raise TrainingError(f"{self.samples} samples to train {weights} weights on")
        measured = np.concatenate([y for _, y in self.training])
        self.initial = float(np.median(measured)) if settings.initial is None else settings.initial
        # the scale keeps relative errors as large as plain ones, for the decay
        self._scale = 1.0 / float(np.mean(1.0 / np.maximum(np.abs(measured), settings.floor)))

    def segments(self, horizon: int | None) -> Segments:
        """Cut the training runs into segments of `horizon` samples, of the longest run's length if None."""
        s = self.settings
        runs = []
        for u, y in self.training:
            columns = [normalised(u[:, j], s.ranges[name]) for j, name in enumerate(self.names[:-1])]
            weight = self._scale / np.maximum(np.abs(y), s.floor) if s.relative else np.ones(len(y))
            runs.append((np.stack(columns, axis=1), normalised(y, s.ranges[self.names[-1]]), weight))
        length = max(len(y) for _, y in self.training)
        start = float(normalised(self.initial, s.ranges[self.names[-1]]))
        return cut(runs, s.delays, start, s.washout, min(horizon or length, length))

    def _edit(self, runs: tuple[Run, ...]) -> list[Run]:
        """Edit the outliers of each channel over all runs: one median and deviation for all of them."""
        columns = []
        for j, name in enumerate(self.names):
            result = edited([(*u.T, y)[j] for u, y in runs], name=name)
            self.edited[name] = result.share
            columns.append(result.runs)
        return [(np.stack(pieces[:-1], axis=1), pieces[-1]) for pieces in zip(*columns, strict=True)]


def _split(runs: list[Run], share: float, least: int) -> tuple[list[Run], list[Run]]:
    """Hold `share` of the runs out, evenly spread; of a single run, its end, if both parts have `least`."""
    if len(runs) > 1:
        count = min(len(runs) - 1, max(1, round(share * len(runs))))
        held = {int((k + 0.5) * len(runs) / count) for k in range(count)}
        return [r for k, r in enumerate(runs) if k not in held], [runs[k] for k in sorted(held)]
    (u, y) = runs[0]
    at = len(y) - max(least, round(share * len(y)))
    if at < least:
        raise TrainingError(f"a single sequence of {len(y)} samples is too short to hold a part of it out")
    return [(u[:at], y[:at])], [(u[at:], y[at:])]
