"""A script: the frames of a lap in order, and plans that change under way."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.codec import Codec
from bench.errors import FaultError, LapError
from bench.faults.spec import parse_fault
from bench.script import Script
from bench.sensors.codes import acquire
from tests.conftest import wavy_lap

MS = 1_000_000
CODEC = Codec()
CODES = acquire(wavy_lap(0.5))


def rest(script):
    """All that is left to be taken."""
    frames = []
    while script.next_ns is not None:
        t_ns = script.next_ns
        frames.append((t_ns, script.take(t_ns)))
    return frames


def test_frames_of_the_schedule():
    """Taken one after the other, the frames are those of the schedule, at their instants."""
    script = Script(CODES, CODEC)
    assert rest(script) == list(script.now.frames)
    assert (script.taken_ns, script.last_ns, script.take(10**12)) == (490 * MS, 490 * MS, None)


def test_nothing_before_it_is_due():
    """A frame that is not due yet is not given."""
    script = Script(CODES, CODEC)
    for _ in range(3):
        script.take(0)
    assert (script.take(9 * MS), script.next_ns, script.taken_ns) == (None, 10 * MS, 0)


@given(at=st.integers(0, 49), late=st.integers(1, 10 * MS))
def test_changed_plan_is_the_planned_one(at, late):
    """A fault that is fired while the lap is sent gives the frames it gives when planned beforehand."""
    t_cmd = at * 10 * MS + late
    if t_cmd > 499 * MS:
        return
    spec = parse_fault(f"rear_stroke:open@{t_cmd / 1e9:.9f}")
    script, sent = Script(CODES, CODEC), []
    while script.next_ns is not None and script.next_ns <= at * 10 * MS:
        t_ns = script.next_ns
        sent.append((t_ns, script.take(t_ns)))
    assert script.follow(script.plan([spec]), t_cmd)
    assert sent + rest(script) == list(Script(CODES, CODEC, [spec]).now.frames)


def test_plan_for_the_past_is_not_followed():
    """A plan that differs from what has been sent already is refused, and nothing changes."""
    script = Script(CODES, CODEC)
    for _ in range(4):
        script.take(10 * MS)
    before = script.now
    plan = script.plan([parse_fault("rear_stroke:open@0.01")])
    assert not script.follow(plan, 10 * MS)
    assert script.now is before
    assert script.follow(plan, 10 * MS + 1)


def test_rate_of_every_message():
    """With a rate of its own every message is sent at it, and the alive count follows it."""
    frames = Script(CODES, CODEC, rate_hz=1000).now.frames
    assert (len(frames), frames.cycle_ns) == (1500, MS)
    strokes = [CODEC.decode("STROKES", f.data)["alive"] for _, f in frames if f.id == 0x100]
    assert strokes == [k % 16 for k in range(500)]


@pytest.mark.parametrize("rate_hz", [0, -1, 3])
def test_rate_that_is_none(rate_hz):
    """A rate whose period is no whole number of nanoseconds is refused by its value."""
    with pytest.raises(LapError, match=f"rate {rate_hz} Hz"):
        Script(CODES, CODEC, rate_hz=rate_hz)


def test_fault_the_lap_cannot_have():
    """A fault after the lap's end is refused."""
    with pytest.raises(FaultError, match=r"lap ends at 0\.499 s"):
        Script(CODES, CODEC, [parse_fault("rear_stroke:open@1")])
