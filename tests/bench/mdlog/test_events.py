"""Faults in the logger's own recordings."""

import can
import numpy as np
import pytest

from bench.codec import Codec
from bench.faults.insertion import insert
from bench.faults.kinds import KINDS
from bench.faults.places import BUS, SENSORS, messages
from bench.faults.spec import parse_fault
from bench.mdlog.events import MESSAGE, events, noted
from bench.mdlog.logger import schedule
from bench.recorder import NOTES, record
from bench.sensors.codes import acquire
from tests.conftest import wavy_lap

CODEC = Codec()


def ridden(*specs, seconds=0.5):
    """The frames the logger asks to send, as if they had travelled at once, and the faults in them."""
    codes, insertions = insert(acquire(wavy_lap(seconds)), [parse_fault(spec) for spec in specs])
    return [(t_ns, frame, "MDLOG") for t_ns, frame in schedule(codes, CODEC)], insertions


def test_a_fault_that_ends_has_two_events():
    """A fault of 0.1 s is noted where it begins and where it ends, with sensor, kind and number."""
    _, insertions = ridden("fork_stroke:short@0.05", "rear_stroke:hold@0.2+0.1")
    rows = events(insertions, CODEC)
    assert [t_ns for t_ns, _, _ in rows] == [50_000_000, 200_000_000, 300_000_000]
    signals = CODEC.message(MESSAGE).signals
    seen = [CODEC.decode(MESSAGE, frame.data) for _, frame, _ in rows]
    assert [(event["acting"], event["number"]) for event in seen] == [(1, 0), (1, 1), (0, 1)]
    assert signals["sensor"].names[int(seen[1]["sensor"])] == "rear_stroke"
    assert signals["kind"].names[int(seen[1]["kind"])] == "hold"


def test_every_place_and_kind_has_its_number():
    """The DBC numbers every place and every fault kind the bench knows, each once."""
    signals = CODEC.message(MESSAGE).signals
    assert sorted(signals["sensor"].names.values()) == sorted((*SENSORS, *messages(), BUS))
    assert sorted(signals["kind"].names.values()) == sorted(KINDS)


def test_events_stand_among_the_frames_in_time():
    """Noting keeps every frame in its order and puts an event before the frames of its instant."""
    rows, insertions = ridden("rear_stroke:open@0.2")
    both = noted(rows, insertions, CODEC)
    assert [row for row in both if row[2] != NOTES] == rows
    times = [row[0] for row in both]
    assert times == sorted(times)
    assert both[times.index(200_000_000)][2] == NOTES


@pytest.mark.parametrize("suffix", [".log", ".asc", ".blf", ".mf4"])
def test_events_lie_on_a_channel_of_their_own(tmp_path, suffix):
    """In every format the events are apart from the bus, which without them is the bus as it was."""
    if suffix == ".mf4":
        pytest.importorskip("asammdf", reason="asammdf is not installed")
    rows, insertions = ridden("rear_stroke:open@0.2+0.1")
    record(tmp_path / f"run{suffix}", noted(rows, insertions, CODEC))
    with can.LogReader(tmp_path / f"run{suffix}") as reader:
        heard = list(reader)
    identifier = CODEC.message(MESSAGE).id
    channels = {m.arbitration_id == identifier: m.channel for m in heard}
    assert channels[True] != channels[False]
    assert all((m.channel == channels[True]) == (m.arbitration_id == identifier) for m in heard)
    at = [m.timestamp for m in heard if m.arbitration_id == identifier]
    assert np.allclose(at, [0.2, 0.3], rtol=0, atol=1e-6)
