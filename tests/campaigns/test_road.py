"""A road plan's trials: laps, instants, ECUs, ids; and carrying one out."""

from dataclasses import replace

import pytest

from bench.errors import FaultError, LapError, RouteError, SensorError
from bench.faults.spec import parse_fault
from bench.laps.files import write_lap
from bench.plant.motorcycle import load_motorcycle
from bench.plant.ride import ride
from bench.plant.route import load_route
from campaigns.errors import CampaignError
from campaigns.laps import Recorded, Simulated
from campaigns.road import LapFile, expand
from campaigns.road_plan import FAULT_FREE, RoadPlan
from campaigns.trial import RoadWork
from dbc import CHANNELS
from targets.ecus import build


def plan(**changes):
    given = {
        "title": "Short",
        "stands_for": "nothing",
        "route": "mixed_5km",
        "laps": 2,
        "seed": 100,
        "seconds": 6,
        "fault_window_s": (2.5, 3),
        "faults": {"open": "rear_stroke:open", "hold": "rear_stroke:hold"},
    }
    return RoadPlan(**{**given, **changes})


@pytest.fixture(scope="module")
def mcu():
    return build("ifd", "mcu")


def trials(mcu, files=(), **changes):
    return expand(plan(**changes), mcu, files)[0]


def test_every_lap_its_own(mcu):
    """Every condition rides laps of its own, seeds counting up, each under an id of its own."""
    found = trials(mcu)
    assert [trial.condition for trial in found] == [FAULT_FREE] * 2 + ["open"] * 2 + ["hold"] * 2
    assert [trial.lap.seed for trial in found] == list(range(100, 106))
    assert len({trial.id for trial in found}) == 6


def test_instants(mcu):
    """Faults come at whole milliseconds inside the window, both its ends possible."""
    found = trials(mcu, laps=100, fault_window_s=(2.5, 2.504))
    instants = {parse_fault(trial.fault).t_cmd_ns // 1_000_000 for trial in found if trial.fault}
    assert instants == {2500, 2501, 2502, 2503, 2504}


def test_instant_from_the_seed(mcu):
    """An instant is drawn from its lap's seed alone: a condition more changes no other's."""
    more = trials(
        mcu, faults={"open": "rear_stroke:open", "hold": "rear_stroke:hold", "z": "rear_stroke:short"}
    )
    assert [t.fault for t in trials(mcu)] == [t.fault for t in more][:6]


def test_points_of_a_sweep_share_their_laps(mcu):
    """The same laps and instants under every magnitude, so that they can be compared."""
    faults = {"gain": "rear_stroke:uncalibration:gain={gain}"}
    found = trials(mcu, faults=faults, sweep={"gain": [0.9, 1.1]})
    low, high = ([t for t in found if t.parameters.get("gain") == gain] for gain in (0.9, 1.1))
    assert [t.lap for t in low] == [t.lap for t in high]
    assert [t.fault.replace("0.9", "1.1") for t in low] == [t.fault for t in high]


def test_phase(mcu):
    """A swept phase puts the fault there within the control period of 10 ms."""
    found = trials(mcu, sweep={"phase_ms": [0, 7.5]})
    phases = {
        (t.parameters.get("phase_ms"), parse_fault(t.fault).t_cmd_ns % 10_000_000) for t in found if t.fault
    }
    assert phases == {(0, 0), (7.5, 7_500_000)}


def test_routes_are_drawn(mcu):
    """Of several routes each lap draws one from its seed."""
    found = trials(mcu, laps=10, route=["mixed_5km", "test_lap"])
    assert {t.lap.route for t in found} == {"mixed_5km", "test_lap"}
    assert found == trials(mcu, laps=10, route=["mixed_5km", "test_lap"])


def test_swept_detector_is_another_ecu(mcu):
    """A swept setting of the detector makes ECUs that differ in it, and trials whose ids tell them apart."""
    found, work = expand(plan(sweep={"detector_threshold": [0.1, 0.2]}), mcu)
    assert [one.calibration.detector.threshold for one in work.builds] == [0.1, 0.2]
    assert len({t.ecu["calibration_sha256"] for t in found}) == 2
    assert len({t.id for t in found}) == len(found) == 12


def test_swept_model(mcu):
    """A swept model is another calibration by its name."""
    _, work = expand(plan(sweep={"model": ["gsxr1000", "gsxr1000_checks"]}), mcu)
    assert [one.calibration.detector.TYPE for one in work.builds] == ["residual", "checks"]


def test_swept_load(mcu):
    """Swept luggage rides the same laps laden, under ids of their own; none is as without a sweep."""
    found, work = expand(plan(faults={}, laps=1, sweep={"load_kg": [0, 20]}), mcu)
    bare, laden = (work.lap(trial).channels for trial in found)
    assert bare["speed_kmh"].tobytes() == laden["speed_kmh"].tobytes()
    assert 7 < (laden["rear_stroke_mm"] - bare["rear_stroke_mm"]).mean() < 9
    assert [trial.lap.document().get("load_kg") for trial in found] == [None, 20.0]
    assert [trial.parameters for trial in found] == [{"load_kg": 0}, {"load_kg": 20}]
    assert found[0].lap == trials(mcu, faults={}, laps=1)[0].lap


FILES = [LapFile("a.parquet", "aa", 10.0, CHANNELS), LapFile("b.parquet", "bb", 2.9, CHANNELS)]


def test_laps_of_ones_own(mcu):
    """Every file is ridden once without a fault, and in turn under each fault."""
    found = trials(mcu, [FILES[0], replace(FILES[1], duration_s=20.0)], laps=3)
    assert [t.lap.file[0] for t in found] == ["a", "b", "b", "a", "b", "a", "b", "a"]


def test_fault_comes_before_a_short_lap_ends(mcu):
    """The window ends a second before the lap does."""
    found = trials(mcu, [replace(FILES[0], duration_s=3.6)], laps=50)
    assert max(parse_fault(t.fault).t_cmd_ns for t in found if t.fault) <= 2_600_000_000


@pytest.mark.parametrize(
    ("lacks", "says"),
    [
        ("speed_kmh", r"^b\.parquet: missing speed_kmh, needed by ecu ifd$"),
        ("acc_front_ms2", r"^b\.parquet: missing acc_front_ms2, needed by fault bump$"),
    ],
)
def test_lap_without_a_channel(mcu, lacks, says):
    """A lap that the ECU, or a fault, cannot do with is refused before any is ridden."""
    channels = tuple(name for name in CHANNELS if name != lacks)
    files = [FILES[0], replace(FILES[1], duration_s=20.0, channels=channels)]
    with pytest.raises(LapError, match=says):
        trials(mcu, files, faults={"open": "rear_stroke:open", "bump": "acc_front:hold"})


def test_file_name_that_is_no_text(mcu):
    """A file whose name no store could keep is refused by it."""
    with pytest.raises(LapError, match=r"^'a\\udcff\.csv': the file's name is no text"):
        trials(mcu, [replace(FILES[0], file="a\udcff.csv")])


@pytest.mark.parametrize("changes", [{"seconds": 3.0}, {}])
def test_lap_shorter_than_the_insertion_time(mcu, changes):
    """A lap that ends before faults come is refused by its name and both times."""
    files = () if changes else FILES
    with pytest.raises(
        CampaignError, match=r"(b\.parquet: 2\.9|mixed_5km: 3) s long, .* come from 2\.5 s on"
    ):
        trials(mcu, files, **changes)


@pytest.mark.parametrize(
    "fault", ["rear_stroke:melt", "tail:open", "rear_stroke:open@5@7", "rear_stroke:uncalibration:gain=x"]
)
def test_unusable_fault(mcu, fault):
    """A fault that could not be inserted is refused before any ride."""
    with pytest.raises(FaultError):
        trials(mcu, faults={"bad": fault})


def test_unknown_setting_of_the_detector(mcu):
    """A setting that the calibration's detector has not is refused with those it has."""
    with pytest.raises(CampaignError, match=r"no setting hold_ratio; it has threshold, window"):
        trials(mcu, sweep={"detector_hold_ratio": [0.1]})


@pytest.mark.parametrize("phase", [10, -1, "late"])
def test_phase_out_of_the_period(mcu, phase):
    """A phase outside of the control period is refused."""
    with pytest.raises(CampaignError, match=r"phase_ms: .* not within 0 to 10"):
        trials(mcu, sweep={"phase_ms": [phase]})


@pytest.mark.parametrize(
    ("sweep", "error", "says"),
    [
        ({"load_kg": ["heavy"]}, CampaignError, "load_kg: 'heavy' is no number"),
        ({"load_kg": [True]}, CampaignError, "load_kg: True is no number"),
        ({"load_kg": [5, -1]}, RouteError, "a load of -1 kg"),
        ({"route": ["mixed_5km", "nowhere"]}, RouteError, "unknown route 'nowhere'"),
        ({"motorcycle": ["gsxr1000", "tank"]}, RouteError, "unknown motorcycle 'tank'"),
        ({"sensors": ["ideal", "none"]}, SensorError, "'none' are neither"),
    ],
)
def test_unknown_parts_are_refused_at_once(mcu, sweep, error, says):
    """What cannot be ridden is refused before the first ride, not when its turn comes."""
    with pytest.raises(error, match=says):
        trials(mcu, sweep=sweep)


@pytest.mark.parametrize("name", ["route", "motorcycle", "load_kg"])
def test_laps_of_ones_own_are_as_they_were_ridden(mcu, name):
    """A sweep of what simulates laps is refused where laps of one's own are ridden: all would be the same."""
    values = {"route": ["test_lap"], "motorcycle": ["naked700"], "load_kg": [10]}[name]
    with pytest.raises(CampaignError, match=f"{name}: laps of one's own are as they were ridden"):
        trials(mcu, FILES[:1], sweep={name: values})


def test_id_follows_content(mcu):
    """A trial's id depends on all that decides its result, and on nothing else."""
    one = trials(mcu)[2]
    others = [
        replace(one, condition="hold"),
        replace(one, parameters={"gain": 1.1}),
        replace(one, lap=Simulated("training", "gsxr1000", 102, 6)),
        replace(one, lap=Simulated("mixed_5km", "naked700", 102, 6)),
        replace(one, lap=Simulated("mixed_5km", "gsxr1000", 102, 6, 5.0)),
        replace(one, lap=Recorded("a.csv", "00")),
        replace(one, sensors="ideal"),
        replace(one, sensors_seed=3),
        replace(one, fault="rear_stroke:open@2"),
        replace(one, ecu={"ecu": "other"}),
        replace(one, td_max_s=1.0),
        replace(one, ftti_s=1.0),
    ]
    assert len({trial.id for trial in [one, *others]}) == 13
    assert replace(one, build=5).id == one.id


def test_carried_out(mcu):
    """A trial's result has its verdict, instants and steps in cycles; its freeze frame shows the instants."""
    found, work = expand(plan(), mcu)
    trial = found[2]
    result, frame = work(trial)
    assert (result["outcome"], result["named"], result["alarms"]) == ("CD", None, 1)
    assert result["td_ns"] == result["t_alarm_ns"] - result["t_active_ns"]
    assert (result["steps"]["n"], result["steps"]["hz"]) == (600, 22_000_000)
    steps = result["steps"]
    assert 3_000 < steps["least"] <= steps["cycles"] / steps["n"] <= steps["most"] < 8_000
    assert steps["least"] ** 2 * 600 <= steps["squares"] <= steps["most"] ** 2 * 600
    assert 0.05 < result["bus_load"] < 0.15
    end_ns = frame["t0_ns"] + frame["period_ns"] * len(frame["measured_mm"])
    assert frame["t0_ns"] <= result["t_cmd_ns"] - 1_900_000_000
    assert result["t_alarm_ns"] + 900_000_000 <= end_ns
    at = (result["t_alarm_ns"] - frame["t0_ns"]) // frame["period_ns"]
    assert frame["measured_mm"][at] == pytest.approx(110, abs=0.05)
    assert frame["residual_pct"][at] > 10
    assert len({len(frame[name]) for name in ("measured_mm", "predicted_mm", "residual_pct")}) == 1


def test_again(mcu):
    """The same trial again gives the same bytes."""
    found, work = expand(plan(), mcu)
    assert work(found[5]) == work(found[5])


def test_no_instants_no_frame(mcu):
    """A lap without fault and alarm has no freeze frame."""
    found, work = expand(plan(), mcu)
    result, frame = work(found[0])
    assert (result["outcome"], frame) == ("OK", None)


def test_recorded_lap(mcu, tmp_path):
    """A lap of one's own is read from its folder, and refused if it is another one by now."""
    lap = ride(load_route("mixed_5km"), load_motorcycle(), 7, 6.0)
    write_lap(lap, tmp_path / "a.csv")
    [trial] = expand(plan(laps=1, faults={}), mcu, [LapFile("a.csv", lap.digest(), 6.0, CHANNELS)])[0]
    work = RoadWork((mcu,), tmp_path)
    assert work.lap(trial).digest() == lap.digest()
    write_lap(ride(load_route("mixed_5km"), load_motorcycle(), 8, 6.0), tmp_path / "a.csv")
    with pytest.raises(LapError, match=r"a\.csv: is not the lap that the campaign began with"):
        work.lap(trial)
