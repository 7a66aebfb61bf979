"""Campaign files, and the trials a campaign stands for."""

from pathlib import Path

import pytest

from bench.errors import FaultError
from bench.faults.spec import parse_fault
from campaigns.errors import CampaignError
from campaigns.plan import FAULT_FREE, HERE, NAMES, Campaign, Trial, expand, load

GOOD = {
    "title": '"A trial"',
    "stands_for": '"nothing"',
    "route": '"mixed_5km"',
    "laps": "3",
    "seed": "100",
    "fault_window_s": "[2.5, 3]",
    "faults": '{ open = "rear_stroke:open", hold = "rear_stroke:hold" }',
}


@pytest.fixture
def file(tmp_path):
    """Write a campaign file, GOOD but for the changes; None leaves a key out."""

    def write(**changes):
        path = tmp_path / "trial.toml"
        keys = {**GOOD, **changes}
        path.write_text("".join(f"{key} = {value}\n" for key, value in keys.items() if value is not None))
        return str(path)

    return write


@pytest.fixture
def campaign(file):
    return load(file())


def test_file(campaign):
    """A campaign file is read into what it says."""
    assert (campaign.laps, campaign.seed, campaign.fault_window_s) == (3, 100, (2.5, 3.0))
    assert campaign.faults == {"open": "rear_stroke:open", "hold": "rear_stroke:hold"}
    assert campaign.seconds is None


@pytest.mark.parametrize("name", [path.stem for path in HERE.glob("*.toml") if path.stem != "thesis"])
def test_shipped(name):
    """Every shipped campaign loads by its name and expands."""
    campaign = load(name)
    assert name in NAMES
    if isinstance(campaign, Campaign):
        assert len(expand(campaign)) == campaign.laps * (1 + len(campaign.faults))


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"lap": "3"}, "lap: extra inputs are not permitted"),
        ({"laps": None}, "laps: field required"),
        ({"laps": '"three"'}, "laps: .*integer"),
        ({"laps": '"3"'}, "laps: .*integer"),
        ({"laps": "true"}, "laps: .*integer"),
        ({"laps": "2.5"}, "laps: .*integer"),
        ({"laps": "0"}, "laps: .*greater than or equal to 1"),
        ({"seed": "-1"}, "seed: .*greater than or equal to 0"),
        ({"route": "5"}, "route: .*string"),
        ({"seconds": "nan"}, "seconds: .*finite"),
        ({"seconds": "0"}, "seconds: .*greater than 0"),
        ({"fault_window_s": "[2]"}, r"fault_window_s\.1: field required"),
        ({"fault_window_s": "[-1, 2]"}, r"fault_window_s\.0: .*greater than or equal to 0"),
        ({"fault_window_s": "[3, 2]"}, r"fault_window_s: 3\.0 s comes after 2\.0 s"),
        ({"faults": '["rear_stroke:open"]'}, "faults: .*dictionary"),
        ({"faults": "{ fault-free = 'rear_stroke:open' }"}, "'fault-free' is the laps without one"),
        ({"laps": "3 4"}, "not TOML"),
    ],
)
def test_bad_file(file, changes, says):
    """A file that is no campaign is refused in one line that names the file and the key."""
    path = file(**changes)
    with pytest.raises(CampaignError, match=says) as refusal:
        load(path)
    assert str(refusal.value).startswith(f"{path}: ")
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("name", ["none.toml", ".toml"])
def test_no_file(tmp_path, monkeypatch, name):
    """A campaign that is not there, or is a folder, is refused in one line."""
    monkeypatch.chdir(tmp_path)
    Path(".toml").mkdir()
    with pytest.raises(CampaignError, match=rf"{name}(\.toml)?: cannot be read: ") as refusal:
        load(name)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    "fault",
    ["rear_stroke:melt", "tail:open", "rear_stroke:open@5", "rear_stroke:uncalibration:gain=x", ""],
)
def test_unusable_fault(file, fault):
    """A fault that could not be inserted, or carries a time of its own, is refused before any ride."""
    campaign = load(file(faults=f"{{ bad = '{fault}' }}"))
    with pytest.raises(FaultError):
        expand(campaign)


def test_order(campaign):
    """Fault-free laps come first, then each fault's in the file's order, `laps` of each."""
    conditions = [trial.condition for trial in expand(campaign)]
    assert conditions == [FAULT_FREE] * 3 + ["open"] * 3 + ["hold"] * 3


def test_every_lap_its_own(campaign):
    """Every trial rides a lap of its own, seeds counting up from the campaign's, under an id of its own."""
    trials = expand(campaign)
    assert [trial.lap_seed for trial in trials] == list(range(100, 109))
    assert len({trial.id for trial in trials}) == 9


def test_instants(campaign):
    """Faults come at whole milliseconds inside the window, both its ends possible; the others have none."""
    wide = campaign.model_copy(update={"laps": 200, "fault_window_s": (2.5, 2.504)})
    faulty = [trial for trial in expand(wide) if trial.condition != FAULT_FREE]
    instants = {parse_fault(trial.fault).t_cmd_ns // 1_000_000 for trial in faulty}
    assert instants == {2500, 2501, 2502, 2503, 2504}
    assert {trial.fault for trial in expand(wide) if trial.condition == FAULT_FREE} == {""}


def test_instant_from_the_seed(campaign):
    """An instant is drawn from its lap's seed alone: again the same, and in a campaign that begins later."""
    later = campaign.model_copy(update={"seed": 103})
    by_seed = {trial.lap_seed: trial.fault for trial in expand(campaign) if trial.condition == "hold"}
    assert expand(campaign) == expand(campaign)
    shared = {t.lap_seed: t.fault for t in expand(later) if t.lap_seed in by_seed}
    assert {seed: fault.partition("@")[2] for seed, fault in shared.items()} == {
        seed: fault.partition("@")[2] for seed, fault in by_seed.items()
    }
    assert len(set(by_seed.values())) > 1


def test_id_follows_content():
    """A trial's id depends on all of it, and on nothing else."""
    plain = Trial("open", "mixed_5km", "gsxr1000", "ideal", 1, "rear_stroke:open@3", 4.0)
    others = [
        Trial("hold", "mixed_5km", "gsxr1000", "ideal", 1, "rear_stroke:open@3", 4.0),
        Trial("open", "training", "gsxr1000", "ideal", 1, "rear_stroke:open@3", 4.0),
        Trial("open", "mixed_5km", "naked700", "ideal", 1, "rear_stroke:open@3", 4.0),
        Trial("open", "mixed_5km", "gsxr1000", "datasheet", 1, "rear_stroke:open@3", 4.0),
        Trial("open", "mixed_5km", "gsxr1000", "ideal", 2, "rear_stroke:open@3", 4.0),
        Trial("open", "mixed_5km", "gsxr1000", "ideal", 1, "rear_stroke:open@2", 4.0),
        Trial("open", "mixed_5km", "gsxr1000", "ideal", 1, "rear_stroke:open@3", None),
    ]
    assert plain.id == Trial("open", "mixed_5km", "gsxr1000", "ideal", 1, "rear_stroke:open@3", 4.0).id
    assert len({trial.id for trial in [plain, *others]}) == 8


def test_campaign_is_frozen(campaign):
    """A campaign cannot be altered after it was checked."""
    with pytest.raises(ValueError, match="frozen"):
        campaign.laps = 0
    assert isinstance(campaign, Campaign)
