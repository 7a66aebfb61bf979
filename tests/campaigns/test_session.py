"""A session's faults as a campaign: the file, and that each rides again at its instant."""

import pytest

from bench.codec import Codec
from bench.faults.spec import parse_fault
from bench.laps.files import write_lap
from bench.panel import Panel
from bench.part import Part
from bench.run import prepare, run_lap
from bench.session import Session
from campaigns.kinds import lap_file
from campaigns.plan import load
from campaigns.road import expand
from targets.ecus import build
from tests.conftest import wavy_lap

MS = 1_000_000
CODEC = Codec()
WHOLE = Part()


@pytest.fixture
def lap(tmp_path):
    path = tmp_path / "laps" / "short.csv"
    path.parent.mkdir()
    write_lap(wavy_lap(0.6), path)
    return path


def replayed(lap, faults, part=WHOLE):
    """The script of a replay during which each of `faults`, spec without time -> its instants, was fired."""
    script = prepare(lap, (), (), "replay", CODEC, part=part)
    panel = Panel(script)
    for spec, (on_ns, off_ns) in faults.items():
        while script.take(on_ns):
            pass
        number = panel.arm(parse_fault(f"{spec}@0"))
        panel.fire(number, on_ns)
        if off_ns:
            while script.take(off_ns):
                pass
            panel.clear(number, off_ns)
    return script


def campaign(path, script, lap, part=WHOLE, name="short.csv"):
    """The plan of the session's file."""
    path.write_text(Session(name, lap, part, "ideal", 3).toml(script), encoding="utf-8")
    return load(str(path))


def test_rides_again_as_a_campaign(lap, tmp_path):
    """Faults of a session act at the same instants in the campaign's trials and in one virtual ride."""
    ridden = wavy_lap(0.6)
    faults = {
        "rear_stroke:open": (100_123_456, 200 * MS),
        "pitch_rate:hold": (250 * MS, 300 * MS),
        "fork_stroke:uncalibration:gain=1.2": (400 * MS, None),
    }
    script = replayed(ridden, faults)
    plan = campaign(tmp_path / "session.toml", script, ridden)
    trials, work = expand(plan, build("ifd", "mcu"), [lap_file(lap, ridden)], folder=lap.parent)
    assert [trial.fault for trial in trials] == ["", *map(str, script.now.specs)]
    acted = [insertion.t_active_ns for insertion in script.now.insertions]
    assert None not in acted
    assert [work(trial)[0]["t_active_ns"] for trial in trials[1:]] == acted
    again = run_lap(ridden, build("ifd", "mcu").power_on(), script.now.specs)
    assert [insertion.t_active_ns for insertion in again.insertions] == acted


def test_part_in_rounds(tmp_path):
    """A fault in a later round of a part comes at the same place of the whole lap."""
    lap, part = wavy_lap(0.6), Part(100 * MS, 300 * MS, 3)
    script = replayed(lap, {"rear_stroke:open": (450 * MS, 460 * MS)}, part)
    whole = campaign(tmp_path / "session.toml", script, lap, part).faults["1 rear_stroke:open"]
    spec = parse_fault(whole)
    # rounds are of 201 samples; the fault was fired after the frames due at 450 ms
    assert spec.t_cmd_ns == 450 * MS + 1 - 2 * 201 * MS + 100 * MS
    at = script.healthy.t_ns.searchsorted(450 * MS)
    assert script.healthy.codes["rear_stroke"][at] == prepare(lap, (), (), "", CODEC).healthy.codes[
        "rear_stroke"
    ].item(450 - 402 + 100)


def test_session_without_a_fault(tmp_path):
    """A session during which nothing happened is a campaign of one lap."""
    lap = wavy_lap(0.3)
    plan = campaign(tmp_path / "session.toml", replayed(lap, {}), lap)
    assert (plan.faults, plan.laps, plan.sensors, plan.seed) == ({}, 1, "ideal", 3)


@pytest.mark.parametrize("name", ['a "lap".csv', "a\nb\x1b[2J.csv", "\x7f\udcff.csv", "ö" * 250, "\\"])
def test_any_name(tmp_path, name):
    """Whatever the lap's file is called, the session's is a campaign."""
    lap = wavy_lap(0.3)
    plan = campaign(
        tmp_path / "session.toml", replayed(lap, {"speed:open": (100 * MS, None)}), lap, name=name
    )
    assert len(plan.faults) == 1
