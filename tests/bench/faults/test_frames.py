"""The kinds that act on frames: the law of each on a logger's schedule, and that none looks ahead."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.codec import Codec
from bench.errors import FaultError
from bench.faults.bus import strike
from bench.faults.insertion import insert, merged, split
from bench.faults.kinds import KINDS, BusKind
from bench.faults.places import places
from bench.faults.spec import FaultSpec, parse_fault
from bench.mdlog.logger import schedule
from bench.sensors.codes import Codes, acquire
from tests.conftest import wavy_lap

MS = 1_000_000
CODEC = Codec()
CODES = acquire(wavy_lap(20.0))
PLAN = schedule(CODES, CODEC)
STROKES = CODEC.message("STROKES").id
PLACED = [
    (name, place) for name, kind in KINDS.items() if isinstance(kind, BusKind) for place in places(kind.where)
]


def struck(*texts, plan=PLAN):
    return strike(plan, [parse_fault(text) for text in texts], CODEC)


def rows(plan):
    """A schedule as a list of plain tuples."""
    columns = (plan.t_ns, plan.ids, plan.extended, plan.lengths, map(bytes, plan.payload), plan.cycle)
    return list(zip(*(c.tolist() if hasattr(c, "tolist") else c for c in columns), strict=True))


def until(codes, last):
    """The first samples of a lap."""
    return Codes(codes.t_ns[:last], {name: array[:last] for name, array in codes.codes.items()})


@settings(max_examples=60)
@given(st.sampled_from(PLACED), st.integers(0, 1500 * MS), st.integers(1, 1500 * MS), st.integers(1, 1400))
def test_no_kind_looks_ahead(placed, t_cmd, lasts, more_ms):
    """A lap that ends earlier sends the same frames as far as it goes, and so does a shorter fault."""
    name, place = placed
    codes = until(CODES, 3000)
    last = min(t_cmd // MS + more_ms + 10, 3000)
    spec = FaultSpec(place, name, (), t_cmd)
    plan = schedule(codes, CODEC)
    whole = rows(strike(plan, [spec], CODEC)[0])
    short = schedule(until(CODES, last), CODEC)
    if t_cmd <= short.t_ns[-1]:
        end_ns = int(short.t_ns[-1])
        cut = rows(strike(short, [spec], CODEC)[0])
        assert [row for row in whole if row[0] <= end_ns] == [row for row in cut if row[0] <= end_ns]
    ended = rows(strike(plan, [FaultSpec(place, name, (), t_cmd, lasts)], CODEC)[0])
    acting = t_cmd + lasts
    assert [row for row in ended if row[0] < acting] == [row for row in whole if row[0] < acting]


@settings(max_examples=60)
@given(st.sampled_from(PLACED), st.integers(0, 1990 * MS), st.none() | st.integers(1, 10**15))
def test_only_the_window_and_the_place(placed, t_cmd, lasts):
    """Frames outside the fault's time and of other messages stay; what it did first is what is reported."""
    name, place = placed
    plan = schedule(until(CODES, 2000), CODEC)
    after, [truth] = strike(plan, [FaultSpec(place, name, (), t_cmd, lasts)], CODEC)
    # repeats and recovery come later
    end_ns = plan.t_ns[-1] + 1 if lasts is None else t_cmd + lasts + 10 * MS
    mine = {CODEC.message(place).id} if place != "bus" else {*plan.ids.tolist(), 0}
    healthy, faulty = rows(plan), rows(after)

    def apart(row):
        return not t_cmd <= row[0] < end_ns or row[1] not in mine

    assert list(filter(apart, healthy)) == list(filter(apart, faulty))
    assert faulty == sorted(faulty, key=lambda row: row[:2])
    differing = set(healthy) ^ set(faulty)
    repeated = [row[0] for row, following in pairwise(faulty) if row == following]
    first = min([row[0] for row in differing] + repeated, default=None)
    assert (truth.t_active_ns, truth.t_obs_ns) == (first, first)


def test_loss():
    """So many of the message's frames are missing, no other, and the rest are as they were."""
    after, [truth] = struck("STROKES:frame_loss:rate=0.3@5+10")
    assert set(rows(after)) < set(rows(PLAN))
    lost = sorted(set(rows(PLAN)) - set(rows(after)))
    assert {row[1] for row in lost} == {STROKES}
    assert len(lost) == pytest.approx(300, abs=45)
    assert truth.t_active_ns == lost[0][0]
    assert truth.t_end_ns == 15_000 * MS
    every, _ = struck("STROKES:frame_loss:rate=1@5+10")
    assert len(PLAN) - len(every) == 1000
    assert rows(struck("STROKES:frame_loss:rate=0@5+10")[0]) == rows(PLAN)


def test_losses_come_from_the_seed():
    """Another seed, place or instant loses other frames; the same spec the same ones."""
    first = rows(struck("STROKES:frame_loss@5")[0])
    assert first == rows(struck("STROKES:frame_loss@5")[0])
    assert first != rows(struck("STROKES:frame_loss:seed=1@5")[0])
    kept = [
        set(row[5] for row in rows(struck(f"{name}:frame_loss@5")[0]) if row[1] == CODEC.message(name).id)
        for name in ("STROKES", "MOTION")
    ]
    assert kept[0] != kept[1]


@pytest.mark.parametrize("bits", [1, 3, 32, 64])
def test_corruption_is_a_burst(bits):
    """In each struck frame a run of so many payload bits is inverted, at most all, wherever it may be."""
    after, _ = struck(f"STROKES:frame_corruption:rate=1,bits={bits}@0")
    mine = PLAN.ids == STROKES
    wrong = np.unpackbits(after.payload[mine] ^ PLAN.payload[mine], axis=1)
    most = min(bits, 32)  # STROKES has four bytes
    assert (wrong.sum(axis=1) == most).all()
    first = wrong.argmax(axis=1)
    assert all(wrong[k, first[k] : first[k] + most].all() for k in range(len(wrong)))
    assert not wrong[:, 32:].any()
    assert set(first) == set(range(32 - most + 1))
    assert np.array_equal(after.payload[~mine], PLAN.payload[~mine])


def test_repeat():
    """A repeated frame comes once more, later by what was asked for, with payload and cycle unchanged."""
    after, [truth] = struck("MOTION:frame_repeat:rate=1,after=0.003@1+0.05")
    added = sorted(set(rows(after)) - set(rows(PLAN)))
    first = [row for row in rows(PLAN) if row[1] == 0x101 and 1000 * MS <= row[0] < 1050 * MS]
    assert added == [(row[0] + 3 * MS, *row[1:]) for row in first]
    assert truth.t_active_ns == 1003 * MS
    assert len(struck("MOTION:frame_repeat:rate=0.5,after=0@0")[0]) - len(PLAN) == pytest.approx(1000, abs=70)


def test_no_repeat_after_the_logger_is_off():
    """Nothing is sent after the last frame of the schedule."""
    after, [truth] = struck("bus:frame_repeat:rate=1,after=0.5@19.6")
    assert after.t_ns[-1] == PLAN.t_ns[-1]
    late, [truth] = struck("bus:frame_repeat:rate=1,after=10@19.6")
    assert rows(late) == rows(PLAN)
    assert truth.t_active_ns is None


def test_stuck_counter():
    """Each message's counter stays what it was before the fault; signals go on, and so does it afterwards."""
    after, [truth] = struck("bus:stuck_counter@1+1")
    for name in ("STROKES", "MOTION", "ACCELERATIONS"):
        mine = PLAN.ids == CODEC.message(name).id
        t_ns = PLAN.t_ns[mine]
        healthy = CODEC.unpack(name, PLAN.payload[mine])
        faulty = CODEC.unpack(name, after.payload[mine])
        acting = (t_ns >= 1000 * MS) & (t_ns < 2000 * MS)
        assert set(faulty["alive"][acting]) == {99 % 16}
        assert np.array_equal(faulty["alive"][~acting], healthy["alive"][~acting])
        assert all(np.array_equal(faulty[key], healthy[key]) for key in healthy if key != "alive")
    assert (truth.t_active_ns, truth.t_end_ns) == (1000 * MS, 2000 * MS)


def test_counter_stuck_from_the_start():
    """Without an earlier frame the first one's count stays: the fault shows from the second on."""
    _, [truth] = struck("STROKES:stuck_counter@0")
    assert truth.t_active_ns == 10 * MS


def test_babbling():
    """Frames of one identifier come back to back at the rate, among the logger's, which stay as they were."""
    after, [truth] = struck("bus:babbling:rate=2500,id=1,length=3@2.0001+1")
    added = after.cycle < 0
    assert set(after.ids[added]) == {1}
    assert set(after.lengths[added]) == {3}
    assert np.array_equal(after.t_ns[added], 2_000_100_000 + 400_000 * np.arange(2500))
    assert [row for row in rows(after) if row[5] >= 0] == rows(PLAN)
    assert truth.t_active_ns == 2_000_100_000


def test_bus_off():
    """The logger is silent from the command until the fault's end and 128 times 11 bits more."""
    after, [truth] = struck("bus:bus_off@5+2.5")
    assert rows(after) == [row for row in rows(PLAN) if not 5000 * MS <= row[0] < 7_502_816_000]
    assert truth[1:] == (5000 * MS, 5000 * MS, 5000 * MS, 7_502_816_000)
    longer, _ = struck("bus:bus_off:recovery=1@5+2.5")
    assert rows(longer) == [row for row in rows(PLAN) if not 5000 * MS <= row[0] < 8500 * MS]


def test_a_babbling_node_is_not_the_logger():
    """Off the bus is the logger alone: who babbles goes on."""
    after, truths = struck("bus:babbling@2+1", "bus:bus_off@2+1")
    assert np.count_nonzero((after.t_ns >= 2000 * MS) & (after.t_ns < 3000 * MS)) == 3000
    assert [truth.t_active_ns for truth in truths] == [2000 * MS, 2000 * MS]


def test_faults_compose_in_order():
    """The twin of a later fault is the schedule with the earlier ones."""
    both, truths = struck("bus:bus_off@5", "STROKES:stuck_counter@4.995")
    assert truths[1].t_active_ns is None
    assert rows(both) == rows(struck("bus:bus_off@5")[0])


def test_halves():
    """Faults of sensors and of the bus go their own ways and come back in the order they were given."""
    texts = ("bus:bus_off@5+1", "speed:open@1", "STROKES:frame_loss@2", "rear_stroke:hold@3")
    specs = [parse_fault(text) for text in texts]
    codes, at_sensors = insert(CODES, split(specs)[0])
    _, on_bus = strike(schedule(codes, CODEC), split(specs)[1], CODEC)
    assert [insertion.spec for insertion in merged(specs, at_sensors, on_bus)] == specs


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("rear_stroke:open@1", "rear_stroke:open@1: acts on a sensor, not on the bus"),
        ("bus:bus_off@20", "the last frame is sent at 19.99 s"),
        ("bus:bus_off@sector=1/2", "begins or ends on a condition"),
        (
            "MOTION:frame_loss@1",
            "MOTION:frame_loss:rate=0.2@1: nothing is sent: the lap lacks pitch_rate_dps",
        ),
    ],
)
def test_refused(text, says):
    """A fault of a sensor, one past the last frame, and one of a message that is not sent are refused."""
    plan = schedule(acquire(wavy_lap(20.0, ("fork_stroke_mm", "rear_stroke_mm", "speed_kmh"))), CODEC)
    with pytest.raises(FaultError, match=says):
        struck(text, plan=plan)
