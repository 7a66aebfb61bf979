"""Offline trials: drawn one by one, inserted as on the bench, judged as by a detector that rides the lap."""

import json
import pickle
from functools import partial
from hashlib import sha256

import numpy as np
import pytest

from bench import pool
from bench.errors import LapError
from bench.faults.insertion import insert
from bench.faults.spec import parse_fault
from bench.laps.lap import Lap
from bench.mdlog.logger import sampled
from bench.sensors.codes import acquire
from bench.sensors.datasheets import load_sensors
from campaigns import offline as room
from campaigns.errors import CampaignError
from campaigns.laps import Simulated
from campaigns.offline import OfflineTrial, SoeTrial, jobs, prepare, work
from campaigns.offline_lap import fed_measured
from campaigns.soft_sensor import network as free_run
from campaigns.soft_sensor import sequences
from targets.calibration import Calibration
from targets.detector import Checks, Detector
from targets.ifd import alarms, residual
from targets.narx import curves, measures
from tests.campaigns.offline_laps import FAULTS, NARX, followed_lap, plan
from tests.conftest import network, wavy_lap

DETECTOR = Detector(warmup=150)
MODEL = Calibration(NARX, DETECTOR)


@pytest.fixture(scope="module")
def laps():
    return [followed_lap(1), followed_lap(2, 15.0), followed_lap(3, 9.0)]


@pytest.fixture(scope="module")
def prepared(laps):
    return prepare(plan(), laps, MODEL)


def faults(prepared):
    return [job for job in jobs(prepared) if isinstance(job, OfflineTrial)]


def ridden(job, lap, settings):
    """Every cell's first alarm, ns, by riding the faulty lap from its first sample to its last."""
    codes, [truth] = insert(acquire(lap), [parse_fault(job.fault)])
    seen = sampled(codes)
    u, y = np.stack([seen[name] for name in NARX.inputs], axis=1), seen[NARX.output]
    predicted = NARX.free_run(u) if job.feedback == "predicted" else NARX.one_step(u, y)
    found = {}
    for t in settings.T_percent:
        found[f"{t:g}"] = rows = []
        for L in settings.L_ms:
            row = []
            for n in settings.n:
                detector = Detector(t / 100, L // 10, n, "predicted", DETECTOR.warmup, DETECTOR.floor_mm)
                up = np.flatnonzero(alarms(residual(predicted, y, detector), detector))
                row.append(int(up[0]) * 10_000_000 if len(up) else None)
            rows.append(row)
    return truth, found


def test_trials_are_what_riding_the_faulty_laps_gives(laps, prepared):
    """For every fault and feedback the first alarms are those of a detector that rides the whole lap."""
    settings = prepared.plan
    outcomes = set()
    for job in faults(prepared):
        truth, expected = ridden(job, laps[job.lap], settings)
        result, _ = work(job, prepared)
        assert result["t_cmd_ns"] == truth.t_cmd_ns
        assert (result["t_active_ns"], result["t_obs_ns"]) == (truth.t_active_ns, truth.t_obs_ns)
        until = truth.t_active_ns + settings.t_max_s * 1e9
        for key, rows in expected.items():
            watched = [[ns if ns is not None and ns <= until else None for ns in row] for row in rows]
            assert result["first_alarm_ns"][key] == watched
            for ns in np.ravel(watched):
                outcomes.add("MD" if ns is None else "FA" if ns < truth.t_active_ns else "CD")
    assert outcomes == {"FA", "CD", "MD"}


def test_the_network_runs_on_from_any_sample(prepared):
    """A measured-feedback run begun anywhere has the bits of the whole run, and the values of one_step."""
    one = prepared.courses[0]
    whole = fed_measured(NARX, one.u, one.y, 0)
    assert np.abs(whole - NARX.one_step(one.u, one.y)).max() < 1e-9
    for start in (1, 4, 10, 11, 700):
        assert (fed_measured(NARX, one.u, one.y, start) == whole[start:]).all()


def test_samples_and_predictions_are_the_soft_sensor_campaigns(laps):
    """A lap's 100 Hz samples and free run are those that networks are trained and measured on."""
    settings = plan(sensors="datasheet")
    data = sequences(laps, load_sensors("datasheet"))
    predictions = free_run("", NARX, data).predictions
    for one, (u, y), p in zip(prepare(settings, laps, MODEL).courses, data.runs, predictions, strict=True):
        assert (one.u == u).all()
        assert (one.y == y).all()
        assert (one.healthy["predicted"].predicted == p).all()


def test_a_network_that_looks_ahead_is_run_as_one(laps):
    """A shifted network predicts a sample from so many samples before, and is never fed back measured."""
    ahead = network(shift=5)
    found = prepare(plan(), laps, Calibration(ahead, DETECTOR))
    assert found.feedbacks == ("predicted",)
    data = sequences(laps, load_sensors("ideal"))
    assert (found.courses[0].healthy["predicted"].predicted == free_run("", ahead, data).predictions[0]).all()
    with pytest.raises(CampaignError, match="feedback measured: the model looks 5 samples ahead"):
        prepare(plan(feedback=["measured"]), laps, Calibration(ahead, DETECTOR))


def test_a_condition_more_changes_no_other_fault(prepared):
    """Each fault is drawn from seed, condition and number alone, and is the same for every feedback."""
    alone = prepare_again(prepared, plan(faults={"hold": FAULTS["hold"]}, faults_per_kind=5))
    few = {job.id: job.fault for job in faults(alone)}
    every = {job.id: job.fault for job in faults(prepared)}
    assert len(few) == 10
    assert few.items() <= every.items()
    drawn = [job.fault for job in faults(prepared) if job.feedback == "predicted"]
    assert drawn == [job.fault for job in faults(prepared) if job.feedback == "measured"]
    instants = {
        name: [job.fault.split("@")[1] for job in faults(prepared) if job.condition == name]
        for name in FAULTS
    }
    assert instants["open"] != instants["hold"]
    other = faults(prepare_again(prepared, plan(seed=8)))
    assert [job.fault for job in other] != [job.fault for job in faults(prepared)]


def prepare_again(prepared, settings):
    """The same laps for another plan with the same cells and sensors."""
    return room.Prepared(settings, prepared.network, prepared.cells, prepared.courses)


def test_faults_come_at_any_whole_millisecond(prepared):
    """Instants are from the warm-up's end to t_max, or half of the rest, before the lap's end."""
    many = prepare_again(prepared, plan(faults={"hold": FAULTS["hold"]}, faults_per_kind=6000))
    seen = [set(), set(), set()]
    for job in faults(many):
        ns = parse_fault(job.fault).t_cmd_ns
        assert ns % 1_000_000 == 0
        seen[job.lap].add(ns // 1_000_000)
    # laps of 20, 15 and 9 s; from 1.5 s on; 4 s, or half of 7.5 s, are watched afterwards
    for instants, first, last in zip(seen, (1500, 1500, 1500), (15_999, 10_999, 5250), strict=True):
        assert first <= min(instants) < first + 40
        assert last - 40 < max(instants) <= last
    assert len(seen[0]) > 1.2 * len(seen[1]) > 1.5 * len(seen[2])


def test_a_trial_is_known_by_its_content(prepared):
    """Ids are the digest of the canonical document; no two trials share one."""
    every = jobs(prepared)
    assert len({job.id for job in every}) == len(every) == 2 + 2 * 5 * 12
    document = every[5].document()
    text = json.dumps(document, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    assert every[5].id == sha256(text.encode()).hexdigest()[:16]
    assert document["lap"]["sha256"] in {
        lap.digest() for lap in (followed_lap(1), followed_lap(2, 15.0), followed_lap(3, 9.0))
    }
    assert document["detectors"]["threshold"] == {
        "T_percent": [8.0, 10.0], "L_ms": [10, 50, 200], "n": [1, 2, 5], "floor_mm": 0.1, "warmup": 150,
    }  # fmt: skip


def test_another_network_or_warm_up_makes_other_trials(laps, prepared):
    """Whatever decides a result is in the trial's identity."""
    few = plan(faults={"hold": FAULTS["hold"]}, faults_per_kind=1)
    ids = [
        jobs(prepare(settings, laps[:1], Calibration(narx, detector)))[2].id
        for settings, narx, detector in (
            (few, NARX, DETECTOR),
            (few, network(seed=2), DETECTOR),
            (few, NARX, Detector(warmup=151)),
            (few, NARX, Detector(warmup=150, floor_mm=0.2)),
            (plan(faults={"hold": FAULTS["hold"]}, n=[1, 2, 6]), NARX, DETECTOR),
            (plan(faults={"hold": FAULTS["hold"]}, sensors="datasheet"), NARX, DETECTOR),
        )
    ]
    assert len(set(ids)) == len(ids)


def test_a_fault_that_changes_nothing_is_invalid():
    """A stroke held where it stands still has not acted: no instant, no alarm."""
    lap = wavy_lap(12.0)
    still = Lap(lap.t_ns, {**lap.channels, "rear_stroke_mm": np.full(12_000, 50.0)}, "parked")
    found = prepare(plan(faults={"hold": FAULTS["hold"], "open": FAULTS["open"]}), [still], MODEL)
    for job in faults(found):
        result, _ = work(job, found)
        assert (result["t_active_ns"] is None) == (job.condition == "hold")
        assert (result["first_alarm_ns"] is None) == (job.condition == "hold")


def test_a_fault_that_acts_late_is_watched_from_then_on():
    """t_max counts from the first sample that differs, however long after the request that is."""
    lap = wavy_lap(30.0)
    stroke = np.where(np.arange(30_000) < 20_000, 50.0, 20.0)
    late = Lap(lap.t_ns, {**lap.channels, "rear_stroke_mm": stroke}, "late")
    settings = plan(faults={"hold": FAULTS["hold"]}, T_percent=[300], faults_per_kind=40, t_max_s=5)
    found = prepare(settings, [late], MODEL)
    early = [job for job in faults(found) if parse_fault(job.fault).t_cmd_ns < 10e9]
    assert early
    for job in early:
        assert work(job, found)[0]["t_active_ns"] == 20_000_000_000


def test_the_same_results_from_any_number_of_workers(laps, prepared):
    """One and two processes give the same rows in the same order."""

    def rows(workers):
        found = prepare(plan(faults_per_kind=3), laps, MODEL, workers=workers)
        every = jobs(found)
        results = pool.results(partial(work, prepared=found), every, workers)
        return [[job.document(), result] for job, (result, _) in zip(every, results, strict=True)]

    one = rows(1)
    assert rows(2) == one
    assert json.loads(json.dumps(one)) == one


def test_what_workers_need_can_travel(prepared):
    """Another process, or another machine, gets the same results from a pickled copy."""
    copy = pickle.loads(pickle.dumps(prepared))
    for job in jobs(prepared)[::17]:
        assert work(pickle.loads(pickle.dumps(job)), copy) == work(job, prepared)


def test_simulated_laps_have_sensors_of_their_own(monkeypatch):
    """Without laps the plan's are ridden, each with its seed for the sensors; every one is told of."""
    monkeypatch.setattr(Simulated, "ridden", lambda self: followed_lap(self.seed % 7, 8.0))
    told = []
    settings = plan(test={"route": "test_lap", "count": 2, "seed": 30}, faults_per_kind=1)
    found = prepare(settings, None, MODEL, told.append)
    assert told == ["lap 2", "lap 3"]
    document = jobs(found)[0].document()
    assert document["laps"][1] == {
        "lap": {"route": "test_lap", "motorcycle": "gsxr1000", "seed": 31, "seconds": None},
        "sensors_seed": 31,
    }


def test_any_calibration_brings_its_warm_up(laps, prepared):
    """With a calibration of another detector the tables' detector waits as long as that one does."""
    other = prepare(plan(), laps[:1], Calibration(NARX, Checks(warmup=150)))
    assert other.cells == prepared.cells
    assert prepare(plan(), laps[:1], Calibration(NARX, Checks(warmup=160))).cells.warmup == 160


class Counts:
    """A detector that raises its alarm at sample 3, and says how long it was let look."""

    def document(self):
        return {"at": 3}

    def first_alarm(self, measured, predicted):
        assert measured.shape == predicted.shape
        return 3, f"{len(measured)}"


def test_other_detectors_see_the_same_trials(laps, prepared):
    """Another detector gets each faulty lap until it would be too late, and is part of the trial."""
    more = room.Prepared(prepared.plan, NARX, prepared.cells, prepared.courses, {"counts": Counts()})
    for job, plain in zip(faults(more), faults(prepared), strict=True):
        result, _ = work(job, more)
        active = result["t_active_ns"]
        end = min((active + 4_000_000_000) // 10_000_000 + 1, len(prepared.courses[job.lap].y))
        assert result.pop("others") == {"counts": {"first_alarm_ns": 30_000_000, "named": f"{end}"}}
        assert result == work(plain, prepared)[0]
        assert job.id != plain.id
        assert job.document()["detectors"]["counts"] == {"at": 3}


def test_curves_of_the_healthy_laps(prepared):
    """The SOE trial holds each window's survivor function, one of 500 ms too, and shares beyond each T."""
    job = jobs(prepared)[0]
    assert isinstance(job, SoeTrial)
    found = work(job, prepared)[0]["curves"]
    assert list(found) == ["10", "50", "200", "500"]
    runs = [(one.healthy["predicted"].predicted, one.y) for one in prepared.courses]
    errors = measures.deviations(runs, 100, DETECTOR.floor_mm)
    for L, curve in found.items():
        every = curves.soe(errors, int(L) // 10, 10**6)
        where = np.searchsorted(every.tolerance_percent, curve["tolerance_percent"], side="right") - 1
        assert (every.share[where] == curve["share"]).all()
        at = np.searchsorted(every.tolerance_percent, 8.0, side="right") - 1
        assert curve["beyond"]["8"] == pytest.approx(every.share[at], abs=1e-12)
        assert curve["worst_tenth_percent"] == curves.least_of_worst(errors, int(L) // 10)


@pytest.mark.parametrize(
    ("lap", "settings", "error", "says"),
    [
        (
            (2.4,),
            {},
            CampaignError,
            "^lap: lasts 2.399 s, and a fault needs 2.5 s: the detector's warm-up of",
        ),
        (
            (9, ("speed_kmh", "rear_stroke_mm")),
            {},
            LapError,
            "missing fork_stroke_mm, pitch_rate_dps, needed",
        ),
        (
            (9,),
            {"faults": {"a": "acc_rear:open"}},
            CampaignError,
            "fault a: the model does not see acc_rear;",
        ),
    ],
)
def test_unfit_laps_and_faults_are_refused(lap, settings, error, says):
    """A lap too short or without a channel, and a fault the network cannot see, are refused in one line."""
    with pytest.raises(error, match=says) as caught:
        prepare(plan(**settings), [wavy_lap(*lap)], MODEL)
    assert "\n" not in str(caught.value)


@pytest.fixture(scope="module")
def shortest():
    """Many faults in three laps of the warm-up and one second: half of it to begin in, half to watch."""
    settings = plan(faults={"open": FAULTS["open"]}, faults_per_kind=6000)
    return prepare(settings, [wavy_lap(2.501, seed=seed) for seed in range(3)], MODEL)


def test_the_shortest_laps(shortest):
    """Every instant of every lap is drawn, none outside, and the faults act."""
    drawn = {(job.lap, parse_fault(job.fault).t_cmd_ns // 1_000_000) for job in faults(shortest)}
    assert {lap for lap, _ in drawn} == {0, 1, 2}
    assert {ms for _, ms in drawn} == set(range(1500, 2001))
    assert all(work(job, shortest)[0]["t_active_ns"] for job in faults(shortest)[:20])


def test_faults_drawn_alike_all_count(shortest):
    """Two faults at the same instant of the same lap are two trials."""
    every = [job for job in faults(shortest) if job.feedback == "predicted"]
    assert len({(job.lap, job.fault) for job in every}) < len(every)
    assert len({job.id for job in every}) == len(every)
