"""The rig: who acts when, and that a ride ends whatever the ECU does."""

import pytest

from bench.codec import Codec
from bench.mdlog.logger import NODE, schedule
from bench.rig import DRAIN_NS, MOST_WAITING, ride
from bench.sensors.codes import acquire
from bench.watch import Watch
from targets.ecu import Frame, Transmission
from targets.errors import FirmwareFault
from tests.conftest import wavy_lap

MS = 1_000_000
CODEC = Codec()


class Scripted:
    """Answers each MOTION frame after `delay_ns`, up to cycle `last`, and notes how it is called."""

    name = "ifd"

    def __init__(self, delay_ns=300_000, last=10**9):
        self.delay_ns, self.last = delay_ns, last
        self.queue: list[Transmission] = []
        self.reached_ns = 0
        self.asked: list[int] = []
        self.done: list[int] = []

    def ask(self, t_ns, frame):
        self.asked.append(len(self.asked))
        self.queue.append(Transmission(t_ns, self.asked[-1], frame))

    def advance(self, t_ns):
        assert t_ns >= self.reached_ns, "time ran backwards"
        request = self.queue.pop(0) if self.queue and self.queue[0].t_ns <= t_ns else None
        self.reached_ns = request.t_ns if request else t_ns
        return request

    def receive(self, frame, t_ns):
        assert t_ns == self.reached_ns, "a frame at an instant the ECU was not brought to"
        if frame.id == 0x101 and self.last > 0:
            self.last -= 1
            self.ask(t_ns + self.delay_ns, answer(frame.data[4] & 15))

    def sent(self, handle, t_ns):
        assert t_ns == self.reached_ns
        self.done.append(handle)

    def where(self):
        return "pc 0x08000100 in main"


def answer(alive):
    raw = {"predicted_mm": 1, "residual_pct": 2, "alarm": 0, "ready": 1, "alive": alive, "step": 0, "kind": 0}
    return Frame(0x200, CODEC.pack("IFD_STATUS", raw)[0].tobytes())


@pytest.fixture(scope="module")
def frames():
    """A second of a lap: a hundred cycles of three frames."""
    return schedule(acquire(wavy_lap(1.0)), CODEC)


def ridden(frames, ecu, **more):
    watch = Watch(CODEC)
    return ride(frames, ecu, watch, **more), watch


def test_every_cycle_answered(frames):
    """With an ECU that answers, the ride lasts two periods past the last cycle and nothing fails."""
    ecu = Scripted()
    done, watch = ridden(frames, ecu)
    assert (done.failure, watch.cycles, watch.answered) == (None, 100, 100)
    assert done.end_ns == 990 * MS + DRAIN_NS
    assert [d.frame for d in done.frames if d.node == NODE] == [frame for _, frame in frames]
    assert ecu.done == ecu.asked == list(range(100))


def test_frames_come_in_the_order_of_the_bus(frames):
    """The ride's frames are in the order they ended on the bus, and none overlaps another."""
    done, _ = ridden(frames, Scripted())
    assert all(a.t_end_ns < b.t_start_ns for a, b in zip(done.frames, done.frames[1:], strict=False))
    assert done.load.bits == sum(d.bits for d in done.frames)


def test_late_answer(frames):
    """An answer after its period is an overrun, found when the next cycle is due, and where the ECU stood."""
    done, watch = ridden(frames, Scripted(delay_ns=11 * MS))
    assert done.failure == (
        "ECU overrun: no answer to cycle 0, sent at 0 s, by 0.01 s; pc 0x08000100 in main"
    )
    assert (done.end_ns, watch.answered) == (10 * MS, 0)


def test_answer_just_in_time(frames):
    """An answer that ends on the bus before the next cycle is in time."""
    done, _ = ridden(frames, Scripted(delay_ns=9 * MS))
    assert done.failure is None


@pytest.mark.parametrize("answered", [0, 1, 40])
def test_falls_silent(frames, answered):
    """An ECU that stops answering ends the ride within two periods."""
    done, watch = ridden(frames, Scripted(last=answered))
    assert f"no answer to cycle {answered}" in done.failure
    assert watch.answered == answered
    assert done.end_ns == (answered + 1) * 10 * MS


def test_silent_at_the_last_cycle(frames):
    """The last cycle, too, must be answered before the ride ends."""
    done, _ = ridden(frames, Scripted(last=99))
    assert done.failure.startswith("ECU overrun: no answer to cycle 99, sent at 0.99 s, by 1.01 s")


def test_flood_without_end(frames):
    """An ECU that asks for frame after frame in one instant is stopped."""

    class Flood(Scripted):
        def advance(self, t_ns):
            return Transmission(t_ns, 0, Frame(0x7FF, b""))

    done, _ = ridden(frames, Flood())
    assert done.failure == f"ECU floods the bus: {MOST_WAITING + 1} frames wait at 0 s"


def test_babbling_idiot(frames):
    """An ECU that keeps the bus busy at the highest priority starves the logger, and the ride ends."""

    class Babbler(Scripted):
        def advance(self, t_ns):
            if not self.queue and len(self.asked) == len(self.done):
                self.ask(t_ns, Frame(0x000, bytes(8)))
            return super().advance(t_ns)

    done, _ = ridden(frames, Babbler())
    assert done.failure.startswith("ECU overrun: no answer to cycle 0")
    assert done.end_ns == 10 * MS
    assert done.load.load > 0.97


def test_other_identifiers_of_the_ecu(frames):
    """Frames the bench knows nothing of are carried, recorded and otherwise of no account."""

    class Talkative(Scripted):
        def receive(self, frame, t_ns):
            super().receive(frame, t_ns)
            if frame.id == 0x101:
                self.ask(t_ns + self.delay_ns, Frame(0x600, b"hello"))
                self.ask(t_ns + self.delay_ns, Frame(0x200, bytes(7), extended=True))

    done, watch = ridden(frames, Talkative())
    assert (done.failure, watch.answered) == (None, 100)
    assert sum(d.frame == Frame(0x600, b"hello") for d in done.frames) == 100


def test_identifier_of_the_logger(frames):
    """An ECU that sends under the logger's identifier breaks the bus, and the failure says so."""

    class Impostor(Scripted):
        def receive(self, frame, t_ns):
            self.ask(10 * MS, Frame(0x100, bytes(4)))

    ecu = Impostor()
    ecu.ask(0, answer(0))
    done, _ = ridden(frames, ecu)
    assert done.failure == "bus: ifd and MDLOG send identifier 0x100 at once, at 10000000 ns"


def test_frame_that_no_bus_carries(frames):
    """An identifier beyond 11 bits is the ECU's failure, not the bench's."""
    ecu = Scripted()
    ecu.ask(5 * MS, Frame(0x800, b""))
    done, _ = ridden(frames, ecu)
    assert done.failure == "bus: ifd: identifier 0x800 has more than 11 bits"


def test_fault_of_the_firmware(frames):
    """A firmware fault ends the ride with its message; what was on the bus before is kept."""

    class Crash(Scripted):
        def advance(self, t_ns):
            if t_ns >= 25 * MS and not self.queue:
                raise FirmwareFault("data abort at pc 0x08000200 in ecu_step")
            return super().advance(t_ns)

    done, watch = ridden(frames, Crash())
    assert done.failure == "firmware fault: data abort at pc 0x08000200 in ecu_step"
    assert watch.answered == 3
    assert max(d.t_end_ns for d in done.frames) < 25 * MS


def test_same_ride_twice(frames):
    """The same schedule and ECU give the same frames at the same nanoseconds."""
    assert ridden(frames, Scripted())[0] == ridden(frames, Scripted())[0]


def test_progress_about_once_a_second():
    """Progress is told of once a second of the lap, in growing time."""
    told = []
    ridden(schedule(acquire(wavy_lap(3.2)), CODEC), Scripted(), progress=told.append)
    assert [round(t_ns / 1e9) for t_ns in told] == [1, 2, 3]


def test_slow_bus_is_too_slow(frames):
    """At 20 kbit/s the logger's own frames do not fit: the answers come too late."""
    done, _ = ridden(frames, Scripted(), bitrate=20_000)
    assert "no answer to cycle 0" in done.failure
