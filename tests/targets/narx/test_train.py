import builtins
import json
from dataclasses import replace

import numpy as np
import pytest

from targets.errors import TrainingError
from targets.narx import train as room
from targets.narx.measures import relative_error, skill
from targets.narx.network import Narx
from targets.narx.sequences import Sequences
from targets.narx.settings import Settings, Stage, recipe_of
from targets.narx.train import train

BRIEF = Settings(
    neurons=4,
    delays=4,
    washout=30,
    seeds=(0, 1),
    screening=(
        Stage("open", closed=False, iterations=12),
        Stage("closed, short", closed=True, iterations=5, horizon=20, samples=1500),
    ),
    refinement=(Stage("closed", closed=True, iterations=10),),
)
"""Enough for the small system, in about a second."""
QUICK = replace(BRIEF, seeds=(3,), screening=(Stage("open", closed=False, iterations=3),), refinement=())


@pytest.fixture(scope="module")
def result(rides):
    return train(rides(), BRIEF)


def test_accuracy_on_unseen_rides(result, rides):
    """A trained network predicts unseen rides within 3 % and far better than the best constant."""
    for u, y in rides(3, 700, first_seed=100).runs:
        predicted = result.network.free_run(u)[30:]
        assert relative_error(predicted, y[30:]) < 3.0
        assert skill(predicted, y[30:]) > 0.8


def test_closed_loop_stages_help(result):
    """The parallel stages leave every seed better than the series-parallel stage did."""
    for candidate in result.report.candidates:
        assert candidate.judges["closed, short"] < candidate.judges["open"]
    chosen = next(c for c in result.report.candidates if c.seed == result.report.chosen)
    assert chosen.judges["closed"] < chosen.judges["closed, short"]


def test_the_best_seed_is_chosen(result):
    """All seeds are reported, only the best one is refined, and none was better in the end."""
    candidates = result.report.candidates
    assert [c.seed for c in candidates] == [0, 1]
    refined = [c.seed for c in candidates if "closed" in c.judges]
    assert refined == [result.report.chosen]
    screened = {c.seed: c.judges["closed, short"] for c in candidates}
    assert screened[result.report.chosen] == min(screened.values())


def test_report_agrees_with_the_network(result, rides):
    """The reported held-out Er is that of the returned network's free run on the run held out."""
    u, y = rides().runs[3]  # one of six: the middle one
    expected = relative_error(result.network.free_run(u)[30:], y[30:])
    assert result.report.held_out.er_percent == pytest.approx(expected, rel=1e-12)
    assert result.report.samples == 5 * (700 - 30)


def test_same_seed_same_weights(rides):
    """The same data and settings give the same bytes of weights; another seed gives others."""
    stages = (Stage("part", closed=False, iterations=5, horizon=50, samples=500),)
    settings = replace(BRIEF, seeds=(1,), screening=stages, refinement=())
    first, second, other = (
        train(rides(), s).network for s in (settings, settings, replace(settings, seeds=(2,)))
    )
    assert first.W1.tobytes() == second.W1.tobytes()
    assert first.W1.tobytes() != other.W1.tobytes()


def test_shift(rides):
    """A shift of 2 trains a network whose prediction at t is the stroke at t + 2."""
    data = rides()
    ahead = train(data, replace(QUICK, seeds=(0,), shift=2, screening=BRIEF.screening)).network
    assert ahead.shift == 2
    u, y = rides(1, 700, first_seed=100).runs[0]
    predicted = ahead.free_run(u)
    as_meant = relative_error(predicted[30:-2], y[32:])
    assert as_meant < 0.8 * relative_error(predicted[32:], y[32:])


def test_plain_errors_are_judged_by_rmse(rides):
    """Where errors are not relative, iterates are judged by the RMSE in the output's unit."""
    report = train(rides(), replace(BRIEF, seeds=(0,), relative=False)).report
    assert report.candidates[0].judge == pytest.approx(report.held_out.rmse, rel=1e-12)


def test_a_single_ride_is_split(rides):
    """Of a single ride the end is held out."""
    report = train(rides(1, 1000), replace(QUICK, held_out=0.2, screening=BRIEF.screening)).report
    assert report.samples == 800 - 30


def test_outliers_are_edited_only_when_asked(rides):
    """Outlier editing is off by default; when on, the share replaced is reported by channel."""
    data = rides()
    u, y = (part.copy() for part in data.runs[0])
    u[100:110, 0] = 150.0
    data = replace(data, runs=((u, y), *data.runs[1:]))
    assert train(data, BRIEF).report.edited == {}
    edited = train(data, replace(BRIEF, edit=True)).report.edited
    assert list(edited) == ["fork_stroke_mm", "speed_kmh", "rear_stroke_mm"]
    assert edited["fork_stroke_mm"] >= 10 / 4200


def test_progress(rides):
    """Every iteration is told, with its stage and how many it may take."""
    told = []
    report = train(rides(), BRIEF, told.append).report
    assert len(told) == sum(c.iterations for c in report.candidates)
    assert [told[0].stage, told[0].iteration, told[0].iterations] == ["open", 1, 12]
    assert told[-1].seed == report.chosen


def test_patience(rides):
    """A stage ends after so many iterations without a better judgement."""
    told = []
    stages = (Stage("open", closed=False, iterations=200),)
    train(rides(), replace(QUICK, screening=stages, patience=2), told.append)
    assert len(told) < 200
    best = int(np.argmin([step.judge for step in told]))
    assert len(told) == best + 1 + 2


def test_interruption_keeps_the_best(rides):
    """An interruption ends the training with the best network so far, and the report says so."""
    told = []

    def impatient(step):
        told.append(step)
        if step.stage == "closed, short" and step.iteration == 3:
            raise KeyboardInterrupt

    result = train(rides(), BRIEF, impatient)
    assert result.report.interrupted
    assert len(result.report.candidates) == 1
    best = min(step.judge for step in told if step.stage == "closed, short")
    assert result.report.candidates[0].judge == best


@pytest.mark.parametrize("stopped", [1, 3, 5])
def test_resumed_training_ends_in_the_same_bytes(rides, stopped):
    """A training interrupted within any stage and taken up again gives the weights of one left alone."""
    whole = train(rides(), BRIEF)
    states, stages = [], []

    def impatient(step):
        if (step.seed, step.stage) not in stages:
            stages.append((step.seed, step.stage))
        if len(stages) == stopped and step.iteration == 2:
            raise KeyboardInterrupt

    train(rides(), BRIEF, impatient, save=lambda state: states.append(json.dumps(state)))
    assert len(states) == stopped - 1
    begun = []
    resume = json.loads(states[-1]) if states else None
    again = train(rides(), BRIEF, lambda step: begun.append((step.seed, step.stage)), resume=resume)
    assert len(set(begun)) == 5 - (stopped - 1)
    assert again.network.W1.tobytes() == whole.network.W1.tobytes()
    assert repr(again.report) == repr(whole.report)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda state: {**state, "of": "another"}, "other laps or other settings"),
        (lambda state: {"of": state["of"]}, "no state of a training"),
        (lambda state: {**state, "candidates": [{"seed": "x"}]}, "no state of a training"),
        (lambda state: {**state, "candidates": 3}, "no state of a training"),
        (lambda state: [], "no state of a training"),
    ],
)
def test_a_state_of_something_else_is_refused(rides, change, says):
    """What is not a state of this very training is refused in one line."""
    states, one = [], replace(BRIEF, seeds=(0,), refinement=())
    train(rides(), one, save=states.append)
    with pytest.raises(TrainingError, match=says):
        train(rides(), one, resume=change(states[-1]) or [0])


def test_a_refinement_that_diverges_is_undone(rides, monkeypatch):
    """Where the refined network is unstable the screened one it came from is kept."""
    appraise = room._Job.appraise
    thetas = []

    def refined_fails(job, candidate):
        appraise(job, candidate)
        thetas.append(candidate.theta)
        candidate.stable = candidate.stable and len(thetas) <= len(BRIEF.seeds)

    monkeypatch.setattr(room._Job, "appraise", refined_fails)
    kept = train(rides(), BRIEF)
    assert len(thetas) == len(BRIEF.seeds) + 1
    chosen = next(c for c in kept.report.candidates if c.seed == kept.report.chosen)
    assert "closed" not in chosen.judges
    assert chosen.theta.tobytes() != thetas[-1].tobytes()


@pytest.mark.parametrize("spoiled", [0, 3])  # a run trained on, the run held out
@pytest.mark.parametrize("value", [170.0, -60.0, np.nan])  # out of 0-110 mm by more than half of it
def test_a_diverging_network_is_refused(rides, monkeypatch, spoiled, value):
    """If every seed's free run leaves the output's range by far, if only once, there is no network."""
    data = rides()
    measured = {u.tobytes(): y for u, y in data.runs}

    def perfect_but_once(network, u):
        y = measured[u.tobytes()].copy()
        if u.tobytes() == data.runs[spoiled][0].tobytes():
            y[200] = value
        return y

    monkeypatch.setattr(Narx, "free_run", perfect_but_once)
    with pytest.raises(TrainingError, match=r"diverges.* \(seeds 3, 4\)"):
        train(data, replace(QUICK, seeds=(3, 4)))


def test_a_network_no_better_than_a_constant_is_refused(rides, monkeypatch):
    """A free run that stays within range but follows nothing is refused too."""
    monkeypatch.setattr(room._Job, "_first", lambda job, rng: np.zeros(4 * (3 * 4 + 2) + 1))
    monkeypatch.setattr(room, "descend", lambda problem, theta: iter(()))
    with pytest.raises(TrainingError, match="no stable network"):
        train(rides(), QUICK)


@pytest.mark.parametrize("diverges", [True, False])
def test_a_step_to_a_diverging_network_is_not_taken(rides, monkeypatch, diverges):
    """In a closed-loop stage what diverges on any ride is no better, however well it does elsewhere."""
    job = room._Job(rides(), BRIEF, lambda _: None)
    start = job._first(np.random.default_rng(0))
    judges = iter(range(0, -1000, -1))
    monkeypatch.setattr(job, "judge", lambda theta, closed: next(judges))
    monkeypatch.setattr(job, "stable", lambda theta: not diverges or theta.tobytes() == start.tobytes())
    candidate = room.Candidate(0, theta=start)
    job._run_stage(
        candidate, Stage("closed", closed=True, iterations=2, horizon=20), np.random.default_rng(0)
    )
    assert (candidate.theta.tobytes() == start.tobytes()) is diverges


def lags(u, taps):
    """Rows of each input at the `taps` samples before, as the network sees them, and 1."""
    past = np.concatenate([np.repeat(u[:1], taps, axis=0), u])
    columns = [past[taps - k : taps - k + len(u), j] for j in range(u.shape[1]) for k in range(1, taps + 1)]
    return np.column_stack([*columns, np.ones(len(u))])


def test_linear_start_is_the_linear_filter(rides):
    """A network that starts linear begins as the best linear filter of its inputs."""
    settings = replace(BRIEF, seeds=(0,), **recipe_of("linear"))
    job = room._Job(rides(), settings, lambda _: None)
    start = job.network(job._first(np.random.default_rng(0)))
    u = np.concatenate([lags(u, settings.delays)[settings.washout :] for u, _ in job.data.training])
    y = np.concatenate([y[settings.washout :] for _, y in job.data.training])
    weight = 1.0 / np.maximum(np.abs(y), settings.floor)
    filtered = u @ np.linalg.lstsq(u * weight[:, None], y * weight, rcond=None)[0]
    predicted = np.concatenate([start.free_run(u)[settings.washout :] for u, _ in job.data.training])
    assert np.sqrt(np.mean((predicted - filtered) ** 2)) < 0.02 * np.std(filtered)


def test_a_stable_seed_outlives_diverging_ones(rides, monkeypatch):
    """A diverging seed is reported as unstable and another one is chosen."""
    appraise = room._Job.appraise

    def first_fails(job, candidate):
        appraise(job, candidate)
        candidate.stable = candidate.stable and candidate.seed != 0

    monkeypatch.setattr(room._Job, "appraise", first_fails)
    report = train(rides(), BRIEF).report
    assert [c.stable for c in report.candidates] == [False, True]
    assert report.chosen == 1


def test_settings_for_the_closed_loop_are_carried(result):
    """The network carries the ranges, the rate, and the median stroke its delay line starts from."""
    network = result.network
    assert network.input_ranges == ((0.0, 150.0), (0.0, 200.0))
    assert (network.neurons, network.delays, network.rate_hz) == (4, 4, 100.0)
    assert 35.0 < network.initial_mm < 45.0


@pytest.mark.parametrize(
    ("make", "settings", "says"),
    [
        ((3, 34), QUICK, "sequence 0 has 34 samples; washout 30, delays 4 and shift 0"),
        ((3, 36), replace(QUICK, shift=3), "sequence 0 has 36 samples; washout 30, delays 4 and shift 3"),
        ((2, 80), QUICK, "50 samples to train 57 weights on"),
        ((1, 60), QUICK, "a single sequence of 60 samples"),
        (
            (3, 300),
            replace(QUICK, ranges={"speed_kmh": (0.0, 200.0)}),
            "no range to normalise fork_stroke_mm",
        ),
    ],
)
def test_unfit_data(rides, make, settings, says):
    """Too few samples, or a channel without a range, end in one line that says what is missing."""
    with pytest.raises(TrainingError) as refusal:
        train(rides(*make), settings)
    assert says in str(refusal.value)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"neurons": 0}, "neurons is 0"),
        ({"delays": 0}, "delays is 0"),
        ({"shift": -1}, "shift is -1"),
        ({"washout": -1}, "washout is -1"),
        ({"patience": 0}, "patience is 0"),
        ({"decay": float("nan")}, "decay is nan"),
        ({"held_out": 1.0}, "held_out is 1.0"),
        ({"floor": 0.0}, "floor is 0.0"),
        ({"seeds": ()}, "a seed"),
        ({"seeds": (1, -2)}, "seed -2"),
        ({"screening": ()}, "screening stage"),
    ],
)
def test_unfit_settings(change, says):
    """A setting out of range is refused by name and value."""
    with pytest.raises(TrainingError) as refusal:
        Settings(**change)
    assert says in str(refusal.value)


def test_unfit_stage():
    """A stage without iterations is refused by name."""
    with pytest.raises(TrainingError, match="stage open: iterations is 0"):
        Stage("open", closed=False, iterations=0)


def test_without_torch(rides, monkeypatch):
    """Without PyTorch the message says how to install it."""
    found = builtins.__import__

    def missing(name, *args, **kwargs):
        if name == "torch":
            raise ImportError(name)
        return found(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", missing)
    with pytest.raises(TrainingError, match=r"strokebench\[train\]"):
        train(rides(), QUICK)


def test_unknown_device(rides):
    """A device that is not there is refused by name, before training begins."""
    with pytest.raises(TrainingError, match="device abacus"):
        train(rides(), replace(QUICK, device="abacus"))


def test_data_is_left_alone(rides):
    """Training changes no array it was given."""
    data = rides(3, 300)
    before = [part.tobytes() for run in data.runs for part in run]
    train(Sequences(data.inputs, data.output, data.runs), replace(BRIEF, seeds=(0,), edit=True))
    assert [part.tobytes() for run in data.runs for part in run] == before
