"""A live replay in trouble: full queues, another data logger, another pace, faults fired under way."""

import pytest

from bench.codec import Codec
from bench.faults.spec import parse_fault
from bench.live import PATIENCE_NS, RETRY_NS, LiveRig
from bench.mdlog.feed import Feed
from bench.mdlog.logger import NODE, schedule
from bench.panel import Panel
from bench.script import Script
from bench.sensors.codes import acquire
from bench.watch import Watch
from targets.ecu import Frame
from tests.bench.test_live import MS, Desk
from tests.conftest import wavy_lap

CODEC = Codec()


@pytest.fixture(scope="module")
def frames():
    """A fifth of a second of a lap: twenty cycles of three frames."""
    return schedule(acquire(wavy_lap(0.2)), CODEC)


def replayed(frames, desk, **more):
    rig = LiveRig(Feed(frames), desk, Watch(CODEC), clock=desk.clock, **more)
    rig.finish()
    return rig.replayed()


class Full(Desk):
    """A bus whose queue is full for `full_ns` from 50 ms on."""

    def __init__(self, full_ns):
        super().__init__()
        self.full_ns = full_ns

    def send(self, frame, timeout_s=0.0):
        if 50 * MS <= self.now < 50 * MS + self.full_ns:
            return False
        return super().send(frame, timeout_s)


def test_full_queue_is_waited_for(frames):
    """A frame that finds the queue full is tried again; it is late by that, nothing is lost or reordered."""
    desk = Full(3 * MS)
    done = replayed(frames, desk)
    assert [frame for _, frame in desk.out] == [frame for _, frame in frames]
    assert (done.failure, done.unsent, done.refused) == (None, 0, 3 * MS // RETRY_NS)
    assert done.worst_late_ns == 3 * MS


def test_queue_that_stays_full(frames):
    """A frame that finds no room for long is unsent, and the run proves nothing."""
    done = replayed(frames, Full(50 * MS))
    assert (done.unsent, done.failure) == (3, "3 frames were not sent: the interface's queue stayed full")
    assert done.refused == 3 + PATIENCE_NS // RETRY_NS


def test_another_logger(frames):
    """A frame that only a data logger sends, and this one did not, ends the replay with its name."""
    foreign = next(frame for t_ns, frame in frames if t_ns == 150 * MS and frame.id == 0x100)
    desk = Desk()

    def send(frame, timeout_s=0.0):
        if desk.now == 50 * MS and frame.id == 0x102:
            desk.arrivals.append((51 * MS, foreign))
        return Desk.send(desk, frame)

    desk.send = send
    done = replayed(frames, desk)
    assert done.failure == (
        "another data logger is on the bus: STROKES with alive count and data "
        f"{foreign.data.hex()} is none of ours"
    )
    assert sum(node == NODE for _, _, node in done.frames) == 18


def test_own_echo_is_no_other_logger(frames):
    """On a bus that returns what one sends the echoes are known as such, once each."""

    class Echoing(Desk):
        echoes = True

        def send(self, frame, timeout_s=0.0):
            self.arrivals.append((self.now, frame))
            return super().send(frame, timeout_s)

    done = replayed(frames, Echoing())
    assert done.failure is None
    assert sum(node == NODE for _, _, node in done.frames) == 60
    assert len(done.frames) == 80

    class Twice(Echoing):
        def send(self, frame, timeout_s=0.0):
            self.arrivals.append((self.now, frame))
            return super().send(frame, timeout_s)

    assert replayed(frames, Twice()).failure.startswith("another data logger is on the bus: STROKES")


def test_speed(frames):
    """At twice the pace the frames leave in half the time; what is recorded is bench time."""
    desk = Desk()
    done = replayed(frames, desk, speed=2.0)
    assert [t_ns for t_ns, _ in desk.out] == [t_ns // 2 for t_ns, _ in frames]
    assert [row[0] for row in done.frames if row[2] == NODE] == [t_ns for t_ns, _ in frames]
    assert done.failure is None


def test_lateness_is_the_walls(frames):
    """Lateness is told in the wall's time at any pace."""
    done = replayed(frames, Desk(pauses={26 * MS: 6 * MS}), speed=2.0)
    assert done.worst_late_ns == 2 * MS


def test_millisecond_cycles_have_a_control_period():
    """At a kilohertz an answer, and a frame, may be late by some cycles, and not by a control period."""
    lap = schedule(acquire(wavy_lap(0.2)), CODEC, 1000)
    assert replayed(lap, Desk(pauses={51 * MS: 4 * MS})).failure is None
    late = replayed(lap, Desk(pauses={51 * MS: 12 * MS}))
    assert late.failure == "the replay was late by 12.0 ms, the limit is 10 ms"
    silent = Desk(answers=False)
    assert replayed(lap, silent).failure.startswith(
        "ECU overrun: no answer to cycle 0, sent at 0 s, by 0.009 s"
    )


def test_attended_once_a_cycle(frames):
    """Those who attend are called with the bench time once a cycle's frames are out."""
    desk, turns = Desk(), []
    replayed(frames, desk, attend=[lambda t_ns: turns.append((t_ns, len(desk.out)))])
    assert turns == [(10 * k * MS, 3 * (k + 1)) for k in range(20)]


def test_fault_fired_under_way():
    """A fault fired by an attendant gives the frames of the planned one."""
    codes = acquire(wavy_lap(0.2))
    script, desk = Script(codes, CODEC), Desk()
    panel = Panel(script)

    def push(t_ns):
        if t_ns == 100 * MS:
            panel.fire(panel.arm(parse_fault("rear_stroke:open@0")), t_ns)

    LiveRig(script, desk, Watch(CODEC), clock=desk.clock, attend=[push]).finish()
    planned = Script(codes, CODEC, [parse_fault("rear_stroke:open@0.100000001")])
    assert [frame for _, frame in desk.out] == [frame for _, frame in planned.now.frames]
    assert any(frame != Frame(frame.id, bytes(len(frame.data))) for _, frame in desk.out)
