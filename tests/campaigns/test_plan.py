"""Campaign files: the shipped ones, what a road trial's file says, and every refusal in one line."""

from pathlib import Path

import pytest

from campaigns.errors import CampaignError
from campaigns.plan import HERE, NAMES, load
from campaigns.road_plan import FAULT_FREE, RoadPlan

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


def test_file(file):
    """A campaign file is read into what it says."""
    plan = load(file())
    assert (plan.laps, plan.seed, plan.fault_window_s) == (3, 100, (2.5, 3.0))
    assert plan.faults == {"open": "rear_stroke:open", "hold": "rear_stroke:hold"}
    assert plan.seconds is None


def test_every_file_is_shipped_by_name():
    """The names are those of the files beside the code."""
    assert set(NAMES) == {path.stem for path in HERE.glob("*.toml")} - {"thesis"}


@pytest.mark.parametrize("name", NAMES)
def test_shipped(name):
    """Every shipped campaign loads by its name."""
    assert load(name).title


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"lap": "3"}, r"unknown key lap; did you mean laps\?"),
        ({"fault_window_ms": "[2, 3]"}, r"unknown key fault_window_ms; did you mean fault_window_s\?"),
        ({"zzz": "3"}, "unknown key zzz$"),
        ({"laps": None}, "laps: field required"),
        ({"laps": '"three"'}, "laps: .*integer"),
        ({"laps": '"3"'}, "laps: .*integer"),
        ({"laps": "true"}, "laps: .*integer"),
        ({"laps": "2.5"}, "laps: .*integer"),
        ({"laps": "0"}, "laps: .*greater than or equal to 1"),
        ({"seed": "-1"}, "seed: .*greater than or equal to 0"),
        ({"route": "5"}, "route.*string"),
        ({"seconds": "nan"}, "seconds: .*finite"),
        ({"seconds": "0"}, "seconds: .*greater than 0"),
        ({"fault_window_s": "[2]"}, r"fault_window_s\.1: field required"),
        ({"fault_window_s": "[-1, 2]"}, r"fault_window_s\.0: .*greater than or equal to 0"),
        ({"fault_window_s": "[3, 2]"}, r"fault_window_s: 3\.0 s comes after 2\.0 s"),
        ({"faults": '["rear_stroke:open"]'}, "faults: .*dictionary"),
        ({"faults": "{ fault-free = 'rear_stroke:open' }"}, "'fault-free' is the laps without one"),
        ({"claim_per_hour": "1"}, "claim_per_hour: needs `seconds`"),
        ({"claim_per_hour": "1", "seconds": "60", "fault_free_laps": "3"}, "leave out fault_free_laps"),
        ({"faults": "{ gain = 'rear_stroke:uncalibration:gain={gain}' }"}, r"\{gain\} is not swept"),
        ({"sweep": "{ gain = [1.1] }"}, r"sweep\.gain: no fault has a \{gain\}"),
        ({"sweep": "{ route = [] }"}, r"sweep\.route: has no value"),
        ({"sweep": "{ phase_ms = { from = 3, to = 1, step = 1 } }"}, r"sweep\.phase_ms: has no value"),
        ({"sweep": "{ route = ['pave', 'pave'] }"}, r"sweep\.route: has a value twice"),
        ({"sweep": "{ phase_ms = { from = 0, to = 1e9, step = 1e-3 } }"}, "steps from 0 to 1e"),
        ({"sweep": "{ phase_ms = { from = 0, to = 1e12, step = 1e-300 } }"}, "inf steps from 0 to 1e"),
        ({"sweep": "{ phase_ms = { from = 0, to = 1e300, step = 1 } }"}, r"sweep\.phase_ms\.to: .*less than"),
        ({"sweep": "{ phase_ms = { from = 0, to = 1, stp = 1 } }"}, r"phase_ms\.stp; did you mean step\?"),
        ({"sweep": "{ phase_ms = 3 }"}, r"sweep\.phase_ms: .*valid list \(is 3\)"),
        ({"sweep": "{ phase_ms = [0, nan] }"}, r"sweep\.phase_ms\.1: .*neither a word nor a number .*is nan"),
        ({"sweep": "{ load_kg = [[1]] }"}, r"sweep\.load_kg\.0: .*neither a word nor .*is \[1\]"),
        (
            {"sweep": "{ load_kg = { from = 0, to = 9e4, step = 1 }, phase_ms = [0, 5] }"},
            "sweep: 180002 combinations; 100000 are the most",
        ),
        ({"laps": "90000", "sweep": "{ load_kg = [0, 1, 2, 3] }"}, "1080000 trials; 1000000 are the most"),
        ({"claim_per_hour": "1e-6", "seconds": "60"}, "180000006 trials"),
        ({"claim_per_hour": "1e-300", "seconds": "60"}, "claim_per_hour: .*greater than"),
        ({"fault_window_s": "[1, 1e300]"}, r"fault_window_s\.1: .*less than"),
        ({"td_max_s": "1e300"}, "td_max_s: .*less than"),
        ({"seed": f"{10**30}"}, "seed: .*less than"),
        ({"seed": "0x" + "f" * 5000}, r"seed: .* \(is too long to show\)"),
        ({"title": "'" + "x" * 300 + "'"}, r"title: .*at most 200 characters \(is 'x+\.\.\.\)"),
        ({"title": '"a\\nb"'}, "title: .*pattern"),
        ({"title": "[" * 5000 + "]" * 5000}, "nested too deep"),
        ({"a." * 3000 + "a": "1", "title": None}, "unknown key a"),
        ({"faults": "{ a = '' }"}, r"faults\.a: .*at least 1 character"),
        ({"faults": "{ '' = 'rear_stroke:open' }"}, r"faults\.: .*at least 1 character"),
        ({"faults": '{ "\\u001b[31m" = "rear_stroke:open" }'}, "faults.*pattern"),
        ({"laps": "3 4"}, "not TOML"),
        ({"kind": "'rod'"}, "kind is 'rod', none of road"),
    ],
)
def test_bad_file(file, changes, says):
    """A file that is no campaign is refused in one line that names the file and the key."""
    path = file(**changes)
    with pytest.raises(CampaignError, match=says) as refusal:
        load(path)
    assert str(refusal.value).startswith(f"{path}: ")
    assert "\n" not in str(refusal.value)


def test_unknown_name():
    """A name that is nearly a campaign's is refused with the one it may have meant."""
    with pytest.raises(CampaignError, match=r"unknown campaign 'raod'; did you mean road\?"):
        load("raod")


@pytest.mark.parametrize("name", ["none.toml", ".toml"])
def test_no_file(tmp_path, monkeypatch, name):
    """A campaign that is not there, or is a folder, is refused in one line."""
    monkeypatch.chdir(tmp_path)
    Path(".toml").mkdir()
    with pytest.raises(CampaignError, match=rf"{name}(\.toml)?: cannot be read: ") as refusal:
        load(name)
    assert "\n" not in str(refusal.value)


def test_cells_without_a_sweep(file):
    """Fault-free laps come first, then each fault's in the file's order."""
    assert [cell[0] for cell in load(file()).conditions()] == [FAULT_FREE, "open", "hold"]


def test_fault_parameter_multiplies_its_fault_alone(file):
    """A swept parameter makes cells of the faults that have a place for it, and of no other condition."""
    faults = "{ open = 'rear_stroke:open', gain = 'rear_stroke:uncalibration:gain={gain}' }"
    cells = load(file(faults=faults, sweep="{ gain = [0.9, 1.1] }")).conditions()
    assert cells == [
        (FAULT_FREE, "", {}),
        ("open", "rear_stroke:open", {}),
        ("gain", "rear_stroke:uncalibration:gain=0.9", {"gain": 0.9}),
        ("gain", "rear_stroke:uncalibration:gain=1.1", {"gain": 1.1}),
    ]


def test_other_parameters_multiply_all(file):
    """What is swept of laps and ECU makes cells of every condition, but for the phase."""
    sweep = "{ motorcycle = ['gsxr1000', 'naked700'], detector_threshold = [0.1], phase_ms = [0, 5] }"
    cells = load(file(sweep=sweep)).conditions()
    assert len(cells) == 2 + 2 * 2 * 2
    assert cells[0] == (FAULT_FREE, "", {"motorcycle": "gsxr1000", "detector_threshold": 0.1})


def test_range_includes_both_ends(file):
    """A range counts from one end to the other in its own decimals."""
    faults = "{ gain = 'rear_stroke:uncalibration:gain={gain}' }"
    cells = load(file(faults=faults, sweep="{ gain = { from = 0.9, to = 1.1, step = 0.05 } }")).conditions()
    assert [cell[2]["gain"] for cell in cells[1:]] == [0.9, 0.95, 1, 1.05, 1.1]


def test_laps_for_a_claim(file):
    """Fault-free laps are as many as the claim needs: 3 / T per hour after T hours without an alarm."""
    assert load(file(claim_per_hour="0.2", seconds="300")).healthy_laps == 180


def test_plan_is_frozen(file):
    """A plan cannot be altered after it was checked."""
    plan = load(file())
    assert isinstance(plan, RoadPlan)
    with pytest.raises(ValueError, match="frozen"):
        plan.laps = 0
