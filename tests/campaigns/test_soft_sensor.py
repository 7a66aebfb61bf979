"""Soft sensors on laps: data, predictors, campaigns."""

import json

import numpy as np
import pytest

from bench import pool
from bench.errors import LapError
from bench.laps.lap import Lap
from bench.plant.motorcycle import load_motorcycle
from bench.plant.ride import ride
from bench.plant.route import load_route
from bench.sensors.datasheets import IDEAL, load_sensors
from campaigns import narx as room
from campaigns.errors import CampaignError
from campaigns.narx import Cell, grid_cells, grid_trials, grid_work, leave_one_out, performance
from campaigns.narx_plan import Laps, NarxGrid, NarxLeaveOneOut, NarxPerformance
from campaigns.plan import NAMES, load
from campaigns.soft_sensor import (
    INPUTS,
    OUTPUT,
    baselines,
    inputs_of,
    linear,
    network,
    pairs,
    sequences,
)
from campaigns.soft_sensor_tables import chapter_iii, each_run_table, figures, grid_table, performance_table
from targets.calibration import load as load_calibration
from targets.ecus import DEFAULT_CALIBRATION
from tests.conftest import wavy_lap

SHORT = Laps(route="test_lap", count=2, seed=40_000)


@pytest.fixture(scope="module")
def laps():
    route, machine = load_route("test_lap"), load_motorcycle()
    return [ride(route, machine, seed, seconds=40) for seed in (1, 2, 3)]


@pytest.fixture(scope="module")
def data(laps):
    return sequences(laps, load_sensors("datasheet"))


@pytest.fixture
def short_laps(monkeypatch, laps):
    """Campaigns ride the same few seconds whatever they ask for."""
    monkeypatch.setattr(room, "ridden", lambda plan: laps[: plan.count])


def test_sequences_are_what_the_ecu_sees(laps, data):
    """Each run holds every tenth millisecond of the codes, in the thesis's order of inputs."""
    assert data.inputs == INPUTS
    assert [len(y) for _, y in data.runs] == [4000] * 3
    ideal = sequences(laps, IDEAL)
    assert np.abs(ideal.runs[0][1] - laps[0].channels[OUTPUT][::10]).max() <= 110 / 4095 / 2 + 1e-9


def test_antialiasing_takes_out_what_would_fold(laps):
    """With the low-pass a wheel's fast shake does not appear as a slow one."""
    t_s = laps[0].t_ns / 1e9
    shaken = {**laps[0].channels, "fork_stroke_mm": 60 + 5 * np.sin(2 * np.pi * 97 * t_s)}
    lap = Lap(laps[0].t_ns, shaken, "shaken")
    plain, filtered = (sequences([lap], IDEAL, antialias=on).runs[0][0][:, 0] for on in (False, True))
    assert plain.std() > 3
    assert filtered[50:-50].std() < 0.05


def test_inputs_are_those_of_the_thesis_that_every_lap_has(laps):
    """Without a wish the inputs are the thesis's as far as every lap has them."""
    partial = Lap(laps[0].t_ns, {k: laps[0].channels[k] for k in ("fork_stroke_mm", OUTPUT)}, "bicycle")
    assert inputs_of(laps, None) == INPUTS
    assert inputs_of([*laps, partial], None) == ("fork_stroke_mm",)
    assert inputs_of(laps, ["acc_rear_ms2"]) == ("acc_rear_ms2",)


@pytest.mark.parametrize(
    ("channels", "wanted", "says"),
    [
        (("speed_kmh",), None, "missing rear_stroke_mm, needed by training"),
        (("acc_body_ms2", OUTPUT), None, "no input that every lap has"),
        (("fork_stroke_mm", OUTPUT), ["speed_kmh"], "missing speed_kmh, needed by training"),
        (("fork_stroke_mm", OUTPUT), [OUTPUT], "input 'rear_stroke_mm' is none of"),
    ],
)
def test_unfit_laps_are_refused(channels, wanted, says):
    """A lap that lacks what training needs is refused by name."""
    lap = wavy_lap(1.0)
    lap = Lap(lap.t_ns, {name: lap.channels[name] for name in channels}, "monday.csv")
    with pytest.raises(LapError, match=says):
        inputs_of([lap], wanted)


def test_a_linear_filter_finds_a_linear_system(data):
    """The least-squares filter predicts an output that is one, to rounding."""
    runs = tuple((u, 3.0 + 0.5 * u[:, 0] + 0.25 * np.roll(u[:, 1], 2)) for u, _ in data.runs)
    made = type(data)(data.inputs, data.output, runs)
    predicted = linear(made, made, 3).predictions[0]
    assert np.abs(predicted - runs[0][1])[100:].max() < 1e-6


def test_baselines_by_what_the_laps_have(data):
    """The half-car sensor needs fork and pitch rate, the rigid one a motorcycle as well."""
    names = [p.name for p in baselines(data, data, load_motorcycle())]
    assert names == ["half-car (II.2)", "half-car, fitted", "best constant"]
    assert [p.name for p in baselines(data, data, None)] == names[1:]
    fork = type(data)(("fork_stroke_mm",), OUTPUT, tuple((u[:, :1], y) for u, y in data.runs))
    assert [p.name for p in baselines(fork, fork, None)] == names[2:]


def test_shipped_network_beats_the_baselines(data):
    """On laps it has never seen the shipped network errs less than half of what any baseline errs."""
    narx = load_calibration(DEFAULT_CALIBRATION).network
    predictors = [network("NARX", narx, data), *baselines(data, data, load_motorcycle())]
    rows = figures(predictors, data)
    best = min(row.performance.er_percent for name, row in rows.items() if name != "NARX")
    assert rows["NARX"].performance.er_percent < 0.5 * best
    assert rows["NARX"].performance.er_percent < 2.0
    text = [str(cell) for cell in performance_table(rows, "laps", chapter_iii()).columns[0].cells]
    assert text == [*rows, "thesis: NARX", "thesis: half-car"]


def test_predictions_stand_beside_their_measurements(data):
    """Pairs are (predicted, measured) run by run."""
    car = baselines(data, data, None)[0]
    for (p, y), (_, measured) in zip(pairs(car, data), data.runs, strict=True):
        assert p.shape == y.shape
        assert y is measured


GRID = NarxGrid(
    kind="narx_grid",
    title="t",
    stands_for="s",
    training=Laps(route="test_lap", count=2, seed=0),
    test=Laps(route="test_lap", count=1, seed=5),
    neurons=[2],
    delays=[1, 2],
    seeds=[0, 1],
    samples=2000,
    iterations=4,
)


def test_a_grid_is_the_same_for_any_number_of_workers(short_laps):
    """One and two processes give equal figures, in the order of the table."""
    trials, work = grid_trials(GRID), grid_work(GRID)
    one = list(pool.results(work, trials, 1))
    assert list(pool.results(work, trials, 2)) == one
    rows = [(trial.document(), result) for trial, (result, _) in zip(trials, one, strict=True)]
    found = grid_cells(GRID, reversed(rows))
    assert [(c.neurons, c.delays, c.seed) for c in found] == [(t.neurons, t.delays, t.seed) for t in trials]


def test_a_grid_cell_that_diverged():
    """A network that diverged is stored as no number, and passes nothing."""
    [trial] = grid_trials(GRID)[:1]
    figures = {"training_percent": None, "test_percent": None}
    [cell] = grid_cells(GRID, [(trial.document(), figures)])
    assert not cell.passes(1e9)


def test_a_grid_cell_counts_the_seeds_that_pass():
    """A cell shows passes over seeds, the best test error of those, and the thesis's word."""
    found = [
        Cell(5, 10, 0, 3.0, 4.0),
        Cell(5, 10, 1, np.inf, np.inf),
        Cell(5, 10, 2, 2.0, 9.99),
        Cell(5, 10, 3, 10.0, 3.0),
    ]
    plan = GRID.model_copy(update={"neurons": [5], "delays": [10], "seeds": [0, 1, 2, 3]})
    assert list(grid_table(plan, found).columns[1].cells) == ["2/4  4.0 %  Yes"]
    assert list(grid_table(plan, found[1:2]).columns[1].cells) == ["0/1  -  Yes"]


def test_performance_campaign_on_the_plans_laps(short_laps):
    """The performance campaign measures the network and three baselines on laps of the plan."""
    narx = load_calibration(DEFAULT_CALIBRATION).network
    plan = NarxPerformance(kind="narx_performance", title="t", stands_for="s", training=SHORT, test=SHORT)
    measured = performance(plan, narx, None, lambda _: None)
    assert measured.predictors[0].name == "NARX network"
    assert len(measured.predictors) == 4
    assert all(len(p.predictions) == 2 for p in measured.predictors)


def test_leave_one_out_predicts_each_ride_from_the_others(monkeypatch, laps):
    """Each ride is predicted by what was trained without it, beside a linear filter as long."""
    trained = []

    def quick(data, settings):
        trained.append(len(data.runs))
        narx = load_calibration(DEFAULT_CALIBRATION).network
        return type("Result", (), {"network": narx})

    monkeypatch.setattr(room, "train", quick)
    plan = NarxLeaveOneOut(kind="narx_leave_one_out", title="t", stands_for="s", delays=5)
    measured = leave_one_out(plan, laps, "ideal", 1, lambda _: None)
    assert trained == [2, 2, 2]
    assert [p.name for p in measured.predictors][1] == "linear FIR, 5 taps"
    assert len(each_run_table(measured).rows) == 3


def test_every_shipped_campaign_loads():
    """Each campaign that comes with the bench is valid, and an unknown one is refused with the names."""
    for name in NAMES:
        assert load(name).title
    with pytest.raises(CampaignError, match="unknown campaign 'nothing'; the known ones are demo, "):
        load("nothing")


def test_an_unknown_kind_is_refused(tmp_path):
    """A campaign of no known kind is refused by value."""
    path = tmp_path / "mine.toml"
    path.write_text('kind = "lottery"\ntitle = "x"\n')
    with pytest.raises(CampaignError, match="kind is 'lottery', none of road, offline, narx_grid"):
        load(str(path))


def test_figures_become_json(data):
    """Figures are plain data."""
    rows = figures(baselines(data, data, None), data)
    again = json.loads(json.dumps({name: row.document() for name, row in rows.items()}))
    assert set(again["best constant"]["soe_10_percent"]) == {"10 ms", "500 ms"}
