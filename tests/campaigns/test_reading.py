"""A store whose documents are not what a run of this version leaves is refused by what is wrong in it."""

import json

import pytest

from campaigns import kinds
from campaigns.errors import CampaignError
from campaigns.export import document
from campaigns.offline import jobs, prepare, work
from campaigns.reading import frame_of, plan_of, rows_of
from campaigns.store import Store, trial_id
from targets.calibration import Calibration
from targets.detector import Detector
from tests.campaigns import offline_laps
from tests.campaigns.synthetic import CAMPAIGN, PLAN, ROAD, frame, row

GOOD = row("hold", "CD", 1, 0.4)


@pytest.fixture
def kept(tmp_path):
    """A store of that campaign and one row, read again: its plan, its rows."""

    def read(campaign, trial, result, shown=None):
        path = tmp_path / "a.sqlite"
        with Store.open(path, campaign) as store:
            store.put(trial_id(trial), trial, result, shown)
        with Store.read(path) as store:
            plan = plan_of(store)
            return plan, rows_of(store, plan), frame_of(store, trial_id(trial))

    return read


def altered(given, where, value):
    """A copy with another value at PART.PART; without it if the value is Ellipsis."""
    copy = json.loads(json.dumps(given))
    *parts, last = where.split(".")
    place = copy
    for part in parts:
        place = place[part]
    if value is ...:
        del place[last]
    else:
        place[last] = value
    return copy


def test_what_a_run_leaves(kept):
    """A store is read as its plan, with the conditions in the file's order, and its rows."""
    plan, [found], shown = kept(ROAD, GOOD.trial, GOOD.result, frame(0))
    assert plan == PLAN
    assert list(plan.faults) == ["hold", "open"]
    assert (found.trial, found.result) == (GOOD.trial, GOOD.result)
    assert shown == frame(0)


@pytest.mark.parametrize(
    ("where", "value", "says"),
    [
        *((name, ..., f"campaign: {name}: field required") for name in ("name", "laps", "versions")),
        ("ecu", 3, "campaign: ecu: "),
        ("ecu", [{"ecu": "ifd", "runs_on": "moon"}], r"campaign: ecu\.0\.runs_on: "),
        ("conditions", ["hold", "melt"], "holds no campaign that can be reported on"),
        ("plan.kind", "melt", "holds no campaign that can be reported on"),
        ("plan.kind", ["road"], "holds no campaign that can be reported on"),
        ("plan.laps", 0, "holds no campaign that can be reported on"),
        ("plan", {"kind": "narx_performance", "title": "", "stands_for": ""}, "holds no campaign that can"),
    ],
)
def test_damaged_campaign(kept, where, value, says):
    """What the campaign's document lacks is named."""
    with pytest.raises(CampaignError, match=rf"^\S+/a\.sqlite: .*{says}"):
        kept(altered(ROAD, where, value), GOOD.trial, GOOD.result)


@pytest.mark.parametrize(
    ("where", "value", "says"),
    [
        ("trial.kind", "offline", r"trial \w{16}: kind is 'offline', none of road"),
        ("trial.condition", ..., r"trial \w{16}: condition: field required"),
        ("trial.parameters", [1], "parameters: "),
        ("trial.lap", 3, "lap: "),
        ("trial.fault", None, "fault: "),
        ("trial.ecu.runs_on", "moon", r"ecu\.runs_on: "),
        ("result.outcome", "melt", r"result of trial \w{16}: outcome: "),
        ("result.reason", ..., "reason: field required"),
        ("result.td_ns", "a while", "td_ns: "),
        ("result.td_ns", 0.5, "td_ns: "),
        ("result.steps", 3, "steps: "),
        ("result.steps.hz", ..., r"steps\.hz: field required"),
    ],
)
def test_damaged_row(kept, where, value, says):
    """What a trial or its result lacks is named, with the trial."""
    both = altered({"trial": GOOD.trial, "result": GOOD.result}, where, value)
    with pytest.raises(CampaignError, match=rf"a\.sqlite: is damaged: .*{says}") as refusal:
        kept(ROAD, both["trial"], both["result"])
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("where", "value", "says"),
    [
        ("t0_ns", ..., "t0_ns: field required"),
        ("period_ns", 0, "period_ns: .*greater than 0"),
        ("measured_mm", [1.0, "a"], r"measured_mm\.1: "),
        ("measured_mm", [1.0], "its series differ in length"),
    ],
)
def test_damaged_frame(kept, where, value, says):
    """What a freeze frame lacks is named, with its trial."""
    with pytest.raises(CampaignError, match=rf"is damaged: freeze frame of trial \w{{16}}: .*{says}"):
        kept(ROAD, GOOD.trial, GOOD.result, altered(frame(0), where, value))


@pytest.fixture(scope="module")
def offline():
    """An offline campaign's document, and the trials of its curves and of one fault with their results."""
    plan = offline_laps.plan(faults_per_kind=1, faults={"open": "rear_stroke:open"})
    calibration = Calibration(offline_laps.NARX, Detector(warmup=150))
    prepared = prepare(plan, [offline_laps.followed_lap(1, 9.0)], calibration)
    campaign = {**CAMPAIGN, "conditions": ["open"], "plan": plan.model_dump(mode="json")}
    found = [{"trial": job.document(), "result": work(job, prepared)[0]} for job in jobs(prepared)]
    return campaign, next(one for one in found if one["trial"]["kind"] == "offline"), found[0]


def test_offline_rows(kept, offline):
    """What an offline campaign leaves is read, and its tables are made of it."""
    campaign, fault, _ = offline
    plan, rows, _ = kept(campaign, **fault)
    assert document(campaign, kinds.tables(plan, rows), [])["tables"]["n"] == 1


@pytest.mark.parametrize(
    ("which", "where", "value"),
    [
        (1, "trial.condition", "melt"),
        (1, "result.first_alarm_ns.8", ...),
        (1, "result.first_alarm_ns.8", [[None]]),
        (1, "result.first_alarm_ns", None),
        (1, "result.others", {"mine": {"first_alarm_ns": None, "named": None}}),
        (2, "result.curves.500", ...),
        (2, "result.curves.10.beyond.8", ...),
    ],
)
def test_offline_rows_of_other_cells(kept, offline, which, where, value):
    """A row that lacks a T, L or n of the plan, or is of what the plan has not, is refused."""
    both = altered(offline[which], where, value)
    with pytest.raises(CampaignError, match=r"is damaged: result of trial \w{16}: is not of the plan's"):
        kept(offline[0], **both)
