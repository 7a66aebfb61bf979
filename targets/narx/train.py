"""Training a NARX network: seeds screened, the best refined, judged by runs it was not trained on.

Belongs here: the procedure, from channels to a network and a report. Never: a file, a screen.
The recipe departs from section III.1 in one thing: after the series-parallel stage the *parallel* error
is minimised, since that is the form which is deployed. `settings.SERIES_PARALLEL` is the thesis's own.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from hashlib import sha256
from itertools import islice
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from targets.errors import TrainingError
from targets.narx import measures
from targets.narx.jacobian import unpacked
from targets.narx.lm import descend
from targets.narx.network import Narx
from targets.narx.objective import Objective, load_torch
from targets.narx.ready import Ready, Run
from targets.narx.sequences import Sequences
from targets.narx.settings import Settings, Stage

Floats = NDArray[np.float64]


class Progress(NamedTuple):
    """One iteration done.

    judge: held-out Er in percent (RMSE where errors are not relative), of the form the stage trains.
    """

    seed: int
    stage: str
    iteration: int
    iterations: int
    cost: float
    judge: float


@dataclass(frozen=True)
class Quality:
    """Free-run figures over some runs, washout not counted: Er (eq. III.2), RMSE, skill (see measures)."""

    er_percent: float
    rmse: float
    skill: float


@dataclass
class Candidate:
    """What became of one seed.

    judges: held-out Er in percent (or RMSE) of its free run after each stage. stages: how many are done.
    """

    seed: int
    judges: dict[str, float] = field(default_factory=dict)
    iterations: int = 0
    stages: int = 0
    stable: bool = False
    theta: Floats = field(default_factory=lambda: np.zeros(0), repr=False)
    judge: float = np.inf


@dataclass(frozen=True)
class Report:
    """What the training did. candidates: every seed, the refined one included; chosen: its seed.

    training, held_out: quality of the network's free run; the held-out runs chose it, so runs that had
    no part in this are still needed for an honest figure. edited: share of samples replaced, by channel.
    """

    candidates: tuple[Candidate, ...]
    chosen: int
    training: Quality
    held_out: Quality
    samples: int
    edited: dict[str, float]
    interrupted: bool


class TrainingResult(NamedTuple):
    """A network and how it came about."""

    network: Narx
    report: Report


WORSE = 1.25
"""A network this much worse than a constant on any run is caught in a wrong rest position there."""

LINEAR_REACH = 0.15
"""How far the first neuron of a linear start goes on its curve: tanh errs by 0.8 % there."""

State = dict[str, Any]
"""Where a training stands, as plain numbers and strings: what `train` hands out and takes up again."""


def train(
    data: Sequences,
    settings: Settings | None = None,
    progress: Callable[[Progress], None] | None = None,
    resume: State | None = None,
    save: Callable[[State], None] | None = None,
) -> TrainingResult:
    """Train a network for data.output on data.inputs.

    Every seed goes through the screening stages, the best one that is stable through the refinement; a
    refinement that leaves it unstable is undone. The same data and settings give the same weights, byte for
    byte, on one machine with one number of threads. KeyboardInterrupt ends the training with the best network
    so far. save is given the state after every stage; resume: a state to go on from, which ends in the same
    bytes as a training that was never interrupted.
    Raises TrainingError for data that cannot be trained on, for a state of other data or settings, and if no
    seed gave a network whose free run stays, on every run, within the output's range (half of it beyond at
    most) and is better than a constant over all of them, and clearly worse on none.
    """
    job = _Job(data, settings or Settings(), progress or (lambda _: None))
    candidates = job.restored(resume) if resume else []
    job.saved = lambda: (save or (lambda _: None))(job.state(candidates))
    interrupted = False
    try:
        known = {candidate.seed for candidate in candidates}
        candidates += [Candidate(seed) for seed in job.settings.seeds if seed not in known]
        for candidate in candidates:
            job.run(candidate, job.settings.screening, 0)
        best = _best(candidates)
        if best is not None:
            screened = replace(best, judges=dict(best.judges))
            job.run(best, job.settings.refinement, len(job.settings.screening))
            if not best.stable:
                candidates[:] = [screened if candidate is best else candidate for candidate in candidates]
                job.saved()
    except KeyboardInterrupt:
        interrupted = True
        candidates = [candidate for candidate in candidates if candidate.theta.size]
        for candidate in candidates:
            job.appraise(candidate)
    best = _best(candidates)
    if best is None:
        seeds = ", ".join(str(candidate.seed) for candidate in candidates)
        raise TrainingError(
            f"no stable network: each one's free run diverges somewhere or is no better than a constant "
            f"(seeds {seeds})"
        )
    network = job.network(best.theta)
    report = Report(
        tuple(candidates),
        best.seed,
        job.quality(network, job.data.training),
        job.quality(network, job.data.held_out),
        job.data.samples,
        job.data.edited,
        interrupted,
    )
    return TrainingResult(network, report)


_WEIGHTS = 1_000_000
"""Number of the random stream of the first weights, apart from the stages'."""


def _stream(seed: int, number: int) -> np.random.Generator:
    return np.random.Generator(np.random.PCG64([seed, number]))


def _best(candidates: list[Candidate]) -> Candidate | None:
    stable = [candidate for candidate in candidates if candidate.stable]
    return min(stable, key=lambda candidate: candidate.judge, default=None)


class _Job:
    """One call of `train`: what is done to a candidate."""

    def __init__(self, data: Sequences, settings: Settings, progress: Callable[[Progress], None]) -> None:
        load_torch(settings.device)  # before any work
        self.source, self.data = data, Ready(data, settings)
        self.settings, self.progress = settings, progress
        self.saved: Callable[[], None] = lambda: None

    def run(self, candidate: Candidate, stages: tuple[Stage, ...], first: int) -> None:
        """Lead a candidate through those of `stages`, numbered from `first`, that it has not behind it.

        At any moment it holds its best theta so far.
        """
        if not candidate.theta.size:
            candidate.theta = self._first(_stream(candidate.seed, _WEIGHTS))
        for number, stage in enumerate(stages, start=first):
            if number >= candidate.stages:
                self._run_stage(candidate, stage, _stream(candidate.seed, number))
                candidate.stages = number + 1
                self.saved()
        self.appraise(candidate)

    def state(self, candidates: list[Candidate]) -> State:
        """What `restored` takes up again."""
        rows = [
            {
                "seed": c.seed,
                "judges": c.judges,
                "iterations": c.iterations,
                "stages": c.stages,
                "theta": c.theta.tolist(),
            }
            for c in candidates
            if c.stages
        ]
        return {"of": self._fingerprint(), "candidates": rows}

    def restored(self, state: State) -> list[Candidate]:
        """The candidates of a state; TrainingError if it belongs to other data or settings."""
        try:
            if state["of"] != self._fingerprint():
                raise TrainingError("the training to go on with had other laps or other settings")
            return [
                Candidate(
                    int(row["seed"]),
                    {str(name): float(judge) for name, judge in row["judges"].items()},
                    int(row["iterations"]),
                    int(row["stages"]),
                    theta=np.array(row["theta"], dtype=np.float64),
                )
                for row in state["candidates"]
            ]
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise TrainingError(f"no state of a training: {error!r}") from None

    def _fingerprint(self) -> str:
        digest = sha256(repr((self.settings, self.data.names, self.source.rate_hz)).encode())
        for u, y in self.source.runs:
            digest.update(u.tobytes() + y.tobytes())
        return digest.hexdigest()

    def appraise(self, candidate: Candidate) -> None:
        """Judge the free run of the theta a candidate holds; without one it is not stable."""
        if candidate.theta.size:
            candidate.judge = self.judge(candidate.theta, closed=True)
            candidate.stable = self.stable(candidate.theta)

    def _run_stage(self, candidate: Candidate, stage: Stage, rng: np.random.Generator) -> None:
        s = self.settings
        segments = self.data.segments(stage.horizon)
        count, length = segments.measured.shape
        taken = count if stage.samples is None else min(count, -(-stage.samples // length))
        if taken < count:
            segments = segments.taken(np.sort(rng.permutation(count)[:taken]))
        problem = Objective(segments, s.neurons, stage.closed, s.decay, s.device, s.single)
        iterates = descend(problem, candidate.theta)
        # each form is judged by its own error: how well a series-parallel network free-runs along its way
        # says little of the parallel network it leads to
        best, last_better = self.judge(candidate.theta, stage.closed), 0
        steady = stage.closed and self.stable(candidate.theta)
        for k, (theta, cost, _) in enumerate(islice(iterates, stage.iterations), start=1):
            judge = self.judge(theta, stage.closed)
            candidate.iterations += 1
            # what diverges on a ride is no better, whatever it does on those that judge
            if judge < best and (not steady or self.stable(theta)):
                candidate.theta, best, last_better = theta, judge, k
                steady = stage.closed and (steady or self.stable(theta))
            self.progress(Progress(candidate.seed, stage.name, k, stage.iterations, cost, judge))
            if k - last_better >= s.patience:
                break
        candidate.judges[stage.name] = self.judge(candidate.theta, closed=True)

    def _first(self, rng: np.random.Generator) -> Floats:
        """Random weights that leave the neurons where their curve bends, neither linear nor saturated."""
        N = self.settings.neurons
        n_x = len(self.data.names) * self.settings.delays
        W1 = rng.uniform(-1.0, 1.0, N * n_x) * np.sqrt(0.75 / n_x)
        if self.settings.linear_start:
            return self._linear(W1.reshape(N, n_x), rng.uniform(-1.0, 1.0, N))
        return np.concatenate([W1, rng.uniform(-1.0, 1.0, N), rng.uniform(-0.3, 0.3, N), [0.0]])

    def _linear(self, W1: Floats, b1: Floats) -> Floats:
        """Weights whose first neuron is the best linear filter of the inputs, fitted by least squares."""
        d = self.settings.delays
        s = self.data.segments(None)
        windows = np.lib.stride_tricks.sliding_window_view(s.v[:, :-1], d, axis=1)[..., ::-1]
        counted = s.weight > 0
        X = windows[counted].reshape(np.count_nonzero(counted), -1)
        X = np.column_stack([X, np.ones(len(X))]) * s.weight[counted][:, None]
        solution = np.linalg.lstsq(X, s.measured[counted] * s.weight[counted], rcond=None)[0]
        filter_, offset = solution[:-1], float(solution[-1])
        # so small that tanh is straight to 1 %
        small = LINEAR_REACH / max(float(np.abs(windows[counted].reshape(len(X), -1) @ filter_).max()), 1e-9)
        W1[0] = 0.0
        W1[0, : filter_.size] = small * filter_
        b1[0] = 0.0
        w2 = np.zeros(len(b1))
        w2[0] = 1.0 / small
        return np.concatenate([W1.ravel(), b1, w2, [offset]])

    def network(self, theta: Floats) -> Narx:
        """Return the network of theta, in physical units."""
        s, *inputs, output = self.settings, *self.data.names
        return Narx(
            tuple(inputs),
            output,
            s.delays,
            tuple(s.ranges[name] for name in inputs),
            s.ranges[output],
            *unpacked(theta, s.neurons),
            self.data.initial,
            s.shift,
            self.source.rate_hz,
        )

    def judge(self, theta: Floats, closed: bool) -> float:
        """Held-out Er in percent, or RMSE where errors are not relative; of the free run, or of one step."""
        network = self.network(theta)
        pairs = [
            (network.free_run(u) if closed else network.one_step(u, y), y) for u, y in self.data.held_out
        ]
        yp, yt = self._joined(pairs)
        if self.settings.relative:
            return measures.relative_error(yp, yt, self.settings.floor)
        return measures.rmse(yp, yt)

    def stable(self, theta: Floats) -> bool:
        """Whether the free run of theta diverges on no run, of training or held out, as `train` says."""
        network = self.network(theta)
        lo, hi = network.output_range
        margin = 0.5 * (hi - lo)
        pairs = [(network.free_run(u), y) for u, y in (*self.data.training, *self.data.held_out)]
        # comparisons with NaN are false
        inside = all(bool(np.all((yp > lo - margin) & (yp < hi + margin))) for yp, _ in pairs)
        predicted, measured = self._joined(pairs)
        constant = float(np.mean(measured))
        better = measures.rmse(predicted, measured) < float(np.std(measured))
        # Run by run, too: one that is caught in a wrong rest position would be lost in the mean over all.
        return inside and better and all(self._follows(pair, constant) for pair in pairs)

    def _follows(self, pair: Run, constant: float) -> bool:
        """Whether a run is not predicted clearly worse than by the constant of all runs."""
        yp, yt = self._joined([pair])
        return measures.rmse(yp, yt) < WORSE * measures.rmse(np.full_like(yt, constant), yt)

    def quality(self, network: Narx, runs: list[Run]) -> Quality:
        """Figures of a network's free run over `runs`."""
        yp, yt = self._joined([(network.free_run(u), y) for u, y in runs])
        return Quality(measures.relative_error(yp, yt), measures.rmse(yp, yt), measures.skill(yp, yt))

    def _joined(self, pairs: list[Run]) -> Run:
        """Put runs of (predicted, measured) behind one another, without their washout."""
        predicted, measured = zip(*pairs, strict=True)
        begin = self.settings.washout
        return (
            np.concatenate([values[begin:] for values in predicted]),
            np.concatenate([values[begin:] for values in measured]),
        )
