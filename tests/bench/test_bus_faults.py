"""Faults of the bus in a ride: what an ECU that gets too little, or nonsense, is held to."""

import pytest

from bench.codec import Codec
from bench.faults.spec import parse_fault
from bench.rig import Rig
from bench.run import finished, run_lap
from bench.script import Script
from bench.sensors.codes import acquire
from bench.verdict import Outcome
from bench.watch import Watch
from tests.bench.test_rig import Scripted
from tests.conftest import wavy_lap

MS = 1_000_000
LAP = wavy_lap(1.0)


class Answering(Scripted):
    """An ECU that answers each MOTION frame, as long as one comes."""

    def receive(self, frame, t_ns):
        if frame.id == 0x101:
            super().receive(frame, t_ns)


@pytest.mark.parametrize(
    ("fault", "unanswered"),
    [
        ("MOTION:frame_loss:rate=1@0.2+0.1", 10),
        ("bus:bus_off:recovery=0.05@0.2+0.1", 0),
        ("MOTION:frame_repeat:rate=1@0.2+0.1", 0),
        ("MOTION:stuck_counter@0.2+0.1", 10),
    ],
)
def test_cycles_without_an_answer_are_the_faults_work(fault, unanswered):
    """While a fault of the bus acts, cycles may stay unanswered: the ride goes on, they are counted."""
    run = run_lap(LAP, Answering(), [parse_fault(fault)])
    assert (run.verdict.outcome, run.ride.failure) == (Outcome.MD, None)
    assert run.watch.unanswered_cycles == unanswered
    assert run.ride.end_ns > 990 * MS


def test_answers_missing_before_the_fault_are_not():
    """An ECU that stopped answering before the fault acted is an overrun as ever."""
    run = run_lap(LAP, Answering(last=10), [parse_fault("MOTION:frame_loss:rate=1@0.5+0.1")])
    assert run.verdict.outcome is Outcome.INVALID
    assert run.ride.failure.startswith("ECU overrun: no answer to cycle 10")


def test_babbling_node_begins_no_cycle():
    """Another node's frames between the logger's are no input cycles."""
    run = run_lap(LAP, Answering(), [parse_fault("bus:babbling:rate=500@0.2+0.2")])
    assert run.watch.cycles == 100
    assert run.watch.unanswered_cycles == 0
    assert sum(d.frame.id == 0 for d in run.ride.frames) > 50


def test_fired_under_way():
    """A fault of the bus that is fired under way is excused from its first frame on."""
    script, watch = Script(acquire(LAP), Codec()), Watch(Codec())
    rig = Rig(script, Answering(), watch)
    rig.advance(305 * MS)
    assert script.follow(script.plan([parse_fault("MOTION:frame_loss:rate=1@0.305+0.1")]), 305 * MS)
    rig.finish()
    run = finished(rig, script, watch)
    assert (run.ride.failure, watch.unanswered_cycles) == (None, 10)
