"""The live pair: pacing, hearing and answering by a clock that a test drives, and over python-can's bus."""

import gc
import threading
import time
from collections import deque

import pytest

from bench.bus.live import Heard, LiveBus
from bench.codec import Codec
from bench.errors import BusError
from bench.live import LiveRig
from bench.mdlog.feed import Feed
from bench.mdlog.logger import NODE, schedule
from bench.run import run_lap
from bench.sensors.codes import acquire
from bench.serve import AHEAD_NS, IDLE_S, LOOK_NS, rehearse, serve
from bench.watch import Watch
from targets.ecu import Frame, Transmission
from targets.emulated import EmulatedEcu
from tests.conftest import wavy_lap

MS = 1_000_000
CODEC = Codec()


@pytest.fixture(scope="module")
def frames():
    """A fifth of a second of a lap: twenty cycles of three frames."""
    return schedule(acquire(wavy_lap(0.2)), CODEC)


def status(alive):
    raw = {
        "predicted_mm": 1,
        "residual_pct": 2,
        "alarm": 0,
        "ready": 1,
        "alive": alive & 15,
        "step": 0,
        "kind": 0,
    }
    return Frame(0x200, CODEC.pack("IFD_STATUS", raw)[0].tobytes())


class Desk:
    """A bus and a clock in one: waiting is what makes time pass.

    arrivals: (instant, frame) to be heard. pauses: instant -> how long the process then does not run.
    cost_ns: what reading one frame takes. With `answers` each MOTION frame is answered a millisecond later.
    stalls: instant of a cycle -> how long the process does not run after the cycle's last frame has left.
    """

    echoes, refusal = False, ""

    def __init__(self, arrivals=(), pauses=None, cost_ns=0, answers=True, stamps=True, stalls=None):
        self.stalls = dict(stalls or {})
        self.now, self.arrivals, self.pauses = 0, deque(arrivals), dict(pauses or {})
        self.cost_ns, self.answers, self.stamps = cost_ns, answers, stamps
        self.out: list[tuple[int, Frame]] = []
        self.waits: list[float] = []

    def clock(self):
        return self.now

    def pass_to(self, t_ns):
        for at in sorted(at for at in self.pauses if at <= t_ns):
            t_ns = max(t_ns, at + self.pauses.pop(at))
        self.now = max(self.now, t_ns)

    def send(self, frame, timeout_s=0.0):
        self.out.append((self.now, frame))
        if self.answers and frame.id == 0x101:
            self.arrivals.append((self.now + MS, status(frame.data[4])))
        if frame.id == 0x102:
            self.now += self.stalls.pop(self.now, 0)
        return True

    def receive(self, timeout_s):
        self.waits.append(timeout_s)
        until = self.now + max(1, round(timeout_s * 1e9))
        if not self.arrivals or self.arrivals[0][0] > until:
            self.pass_to(until)
            if not self.arrivals or self.arrivals[0][0] > self.now:
                return None
        at, frame = self.arrivals.popleft()
        self.pass_to(max(at, self.now) + self.cost_ns)
        return Heard(frame, self.now - at if self.stamps else 0)


def replayed(frames, desk, watch=True, **more):
    seen = Watch(CODEC) if watch else None
    return replay(frames, desk, seen, clock=desk.clock, **more), seen


def replay(frames, bus, watch, **more):
    """The whole of a live replay."""
    rig = LiveRig(Feed(frames), bus, watch, **more)
    rig.finish()
    return rig.replayed()


# --- the logger's end ---------------------------------------------------------------------------------------


def test_frames_leave_when_due(frames):
    """Every frame leaves at its instant and in the schedule's order."""
    desk = Desk()
    done, watch = replayed(frames, desk)
    assert desk.out == list(frames)
    assert (done.failure, done.worst_late_ns, done.mean_late_ns) == (None, 0, 0)
    assert (watch.cycles, watch.answered) == (20, 20)


def test_record_is_in_order_of_time(frames):
    """Sent and heard frames come back in one order, that of their instants, each with its sender."""
    done, _ = replayed(frames, Desk())
    assert [row[0] for row in done.frames] == sorted(row[0] for row in done.frames)
    assert sum(node == NODE for _, _, node in done.frames) == 60
    assert [t_ns for t_ns, _, node in done.frames if node == "ifd"] == [(10 * k + 1) * MS for k in range(20)]


def test_missing_answer_ends_it(frames):
    """An ECU that does not answer ends the replay within two periods."""
    desk = Desk(answers=False)
    done, _ = replayed(frames, desk)
    assert done.failure == "ECU overrun: no answer to cycle 0, sent at 0 s, by 0.01 s"
    assert desk.now == 20 * MS


def test_last_answer_is_waited_for(frames):
    """The answer to the last cycle is still heard, and its want is still noticed."""
    done, watch = replayed(frames, Desk())
    assert watch.unanswered(0) is None
    silent = Desk()
    silent.send = lambda frame: silent.now >= 190 * MS or Desk.send(silent, frame)
    done, _ = replayed(frames, silent)
    assert done.failure.startswith("ECU overrun: no answer to cycle 19")


def test_pause_is_reported_as_lateness(frames):
    """A process that was not running is late by what it missed, and says so; answers in that time count."""
    desk = Desk(pauses={51 * MS: 15 * MS})
    done, _ = replayed(frames, desk)
    assert done.worst_late_ns == 6 * MS
    assert done.mean_late_ns == 6 * MS / 20
    assert done.failure is None


def test_answer_that_was_read_late_is_in_time(frames):
    """An answer that arrived in time but lay unread when the next cycle left is no overrun."""
    desk = Desk(stalls={50 * MS: 11 * MS})
    done, watch = replayed(frames, desk)
    assert (done.failure, watch.answered, done.worst_late_ns) == (None, 20, MS)
    assert (51 * MS, status(5), "ifd") in done.frames
    assert [row[0] for row in done.frames] == sorted(row[0] for row in done.frames)


def test_answer_that_came_late_is_not(frames):
    """An answer that really came after the next cycle had left is an overrun, although it was heard."""
    desk = Desk()
    late = {5}

    def send(frame):
        desk.out.append((desk.now, frame))
        if frame.id == 0x101:
            slow = frame.data[4] in late
            desk.arrivals.append((desk.now + (10 * MS + 1 if slow else MS), status(frame.data[4])))
        return True

    desk.send = send
    done, _ = replayed(frames, desk)
    assert done.failure.startswith("ECU overrun: no answer to cycle 5, sent at 0.05 s, by 0.06 s")


def test_late_by_a_period(frames):
    """A replay late by a period is no verdict on the ECU: that is the failure, before any overrun."""
    done, _ = replayed(frames, Desk(pauses={51 * MS: 30 * MS}, stamps=False))
    assert done.failure == "the replay was late by 21.0 ms, the limit is 10 ms"


def test_late_limit(frames):
    """Who allows for more lateness than a control period has a verdict, and is told how late it was when."""
    desk = Desk(pauses={51 * MS: 20 * MS}, stamps=False)
    done, _ = replayed(frames, desk, late_limit_ns=30 * MS)
    assert (done.failure, done.worst_late_ns) == (None, 11 * MS)
    assert done.worst_late_within(0, 50 * MS) == 0
    assert done.worst_late_within(50 * MS, 200 * MS) == 11 * MS


def test_storm_does_not_make_it_late(frames):
    """However many frames there are to hear, the logger's own leave when they are due."""
    storm = [(k * 50_000, Frame(0x7FF, bytes(8))) for k in range(6000)]
    desk = Desk(storm, cost_ns=60_000, answers=False)
    done, _ = replayed(frames, desk, watch=False)
    assert sum(node == NODE for _, _, node in done.frames) == 60
    assert done.worst_late_ns <= 60_000


def test_without_a_watch(frames):
    """Where no ECU is expected nothing is judged; what is heard is kept."""
    done, _ = replayed(frames, Desk([(5 * MS, Frame(0x123, b"x"))], answers=False), watch=False)
    assert done.failure is None
    assert [(frame.id, node) for _, frame, node in done.frames if node != NODE] == [(0x123, "heard")]


def test_empty_schedule():
    """A lap of which nothing is sent replays nothing, in time."""
    nothing = schedule(acquire(wavy_lap(0.2, names=("speed_kmh",))), CODEC)
    done, _ = replayed(nothing, Desk(), watch=False)
    assert (done.frames, done.worst_late_ns, done.mean_late_ns, done.failure) == ([], 0, 0.0, None)


def test_progress_is_told_after_the_frames(frames):
    """Progress is told when a cycle's frames are out, about once a second."""
    long = schedule(acquire(wavy_lap(2.1)), CODEC)
    desk, told = Desk(), []
    replayed(long, desk, progress=lambda t_ns: told.append((t_ns, len(desk.out))))
    assert told == [(1_000_000_000, 303), (2_000_000_000, 603)]


@pytest.mark.parametrize("failing", ["send", "receive"])
def test_bus_that_goes_away(frames, failing):
    """An error of the bus ends the replay: what was seen is kept, the collector of garbage runs again."""
    desk = Desk()

    def gone(*_):
        raise BusError("vcan0: network is down")

    setattr(desk, failing, gone)
    done, _ = replayed(frames, desk)
    assert (done.failure, str(done.lost)) == ("bus: vcan0: network is down", "vcan0: network is down")
    assert len(done.frames) == (0 if failing == "send" else 3)
    assert gc.isenabled()


# --- the ECU's end ------------------------------------------------------------------------------------------


class Scripted:
    """Answers each frame `delay_ns` of its own time after it came; notes how it is called."""

    name = "ifd"

    def __init__(self, delay_ns=300_000):
        self.delay_ns, self.reached = delay_ns, -1
        self.heard: list[tuple[int, Frame]] = []
        self.done: list[int] = []
        self.queue: list[Transmission] = []

    def advance(self, t_ns):
        if self.queue and self.queue[0].t_ns <= t_ns:
            return self.queue.pop(0)
        self.reached = max(self.reached, t_ns)
        return None

    def receive(self, frame, t_ns):
        self.heard.append((t_ns, frame))
        answer = Frame(0x300, len(self.heard).to_bytes(2, "big"))
        self.queue.append(Transmission(max(t_ns, self.reached) + self.delay_ns, len(self.heard), answer))

    def sent(self, handle, t_ns):
        self.done.append(handle)


def served(ecu, desk, seconds=0.1, **more):
    return serve(ecu, desk, clock=desk.clock, seconds=seconds, **more)


def test_answers_leave_at_once():
    """A frame is answered as soon as it has been read: nothing waits for the ECU's own computing time."""
    ecu, desk = Scripted(), Desk([(10 * MS, Frame(0x100, b"")), (10 * MS, Frame(0x101, b""))], answers=False)
    assert served(ecu, desk).sent == 2
    assert [t_ns for t_ns, _ in desk.out] == [10 * MS, 10 * MS]
    assert ecu.done == [1, 2]


def test_slow_step_is_waited_for():
    """An ECU that needs longer than it is given at once answers when its time has come, within a tick."""
    ecu, desk = Scripted(delay_ns=4 * MS), Desk([(10 * MS, Frame(0x100, b""))], answers=False)
    served(ecu, desk)
    assert 14 * MS <= desk.out[0][0] <= 15 * MS


def test_time_follows_the_clock():
    """With nothing to hear, the ECU's time is the clock's."""
    ecu, desk = Scripted(), Desk(answers=False)
    served(ecu, desk, seconds=1)
    assert ecu.reached == desk.now == 1_000_000_000


def test_no_spinning():
    """An idle ECU wakes at most every few milliseconds, and never waits for no time at all."""
    desk = Desk(answers=False)
    served(Scripted(), desk, seconds=1)
    assert len(desk.waits) <= 1 / IDLE_S + 1
    assert min(desk.waits) == IDLE_S


def test_frames_count_from_their_arrival():
    """After a pause of the process the ECU gets the frames at the instants at which they had come."""
    arrivals = [(10 * k * MS, Frame(0x100, bytes([k]))) for k in range(1, 9)]
    ecu, desk = Scripted(), Desk(arrivals, pauses={12 * MS: 60 * MS}, answers=False)
    served(ecu, desk)
    assert ecu.heard == arrivals
    assert len(desk.out) == 8


def test_backlog_of_the_emulated_mcu(image, calibration):
    """Thirty frames read at once after a pause are ten cycles to the firmware: none is missed."""
    lap = schedule(acquire(wavy_lap(0.1)), CODEC)
    ecu = EmulatedEcu(image, calibration)
    desk = Desk([(t_ns + MS, frame) for t_ns, frame in lap], pauses={0: 150 * MS}, answers=False)
    assert served(ecu, desk, seconds=0.3).sent == 20
    timing = [CODEC.decode("IFD_TIMING", frame.data) for _, frame in desk.out if frame.id == 0x201]
    assert (timing[-1]["missed_inputs"], timing[-1]["overruns"]) == (0, 0)


def test_storm_does_not_run_its_time_away():
    """More frames than a bus carries put the ECU's time ahead by a bounded amount, and it ends in time."""
    storm = [(MS + 10 * k, Frame(0x7FF, b"")) for k in range(2000)]
    ecu, desk = Scripted(), Desk(storm, answers=False, cost_ns=10)
    ahead = []
    receive = desk.receive
    desk.receive = lambda timeout_s: (ahead.append(ecu.reached - desk.now), receive(timeout_s))[1]
    served(ecu, desk)
    assert LOOK_NS < max(ahead) <= AHEAD_NS
    assert len(ecu.heard) == 2000
    assert desk.now <= 106 * MS


def test_ready_after_the_boot():
    """Readiness is told once, when the ECU has been brought to its time 0 and before it hears anything."""
    ecu, told = Scripted(), []
    served(ecu, Desk([(0, Frame(0x100, b""))]), ready=lambda: told.append((ecu.reached, len(ecu.heard))))
    assert told == [(0, 0)]


def test_rehearsal_is_a_whole_cycle(image, calibration):
    """A rehearsed ECU has received, stepped and sent: nothing is left to be compiled."""
    ecu = EmulatedEcu(image, calibration)
    sent = []
    ecu.sent = lambda handle, t_ns, plain=ecu.sent: (sent.append(handle), plain(handle, t_ns))
    rehearse(ecu)
    assert len(sent) == 2


# --- over python-can ----------------------------------------------------------------------------------------


SLOWER = 20
"""Of the wall's pace: what is claimed is about bytes, not about what else this machine does meanwhile."""


def slow_clock():
    return time.monotonic_ns() // SLOWER


class Slowed(LiveBus):
    def receive(self, timeout_s):
        heard = super().receive(timeout_s)
        return heard and Heard(heard.frame, heard.age_ns // SLOWER)


def test_pair_over_python_can(image, calibration):
    """Logger and ECU in two threads: every cycle answered, with the status frames of the virtual run."""
    lap = wavy_lap(0.2)
    ecu = EmulatedEcu(image, calibration)
    rehearse(EmulatedEcu(image, calibration))
    ready, watch = threading.Event(), Watch(CODEC)
    with Slowed("virtual:pair") as here, Slowed("virtual:pair") as there:
        thread = threading.Thread(target=serve, args=(ecu, there, slow_clock, 0.3, ready.set))
        thread.start()
        assert ready.wait(60)
        done = replay(schedule(acquire(lap), CODEC), here, watch, clock=slow_clock)
        thread.join()
    assert (done.failure, watch.answered) == (None, 20)
    virtual = run_lap(lap, EmulatedEcu(image, calibration)).ride.frames
    heard = [frame for _, frame, node in done.frames if node == "ifd" and frame.id == 0x200]
    assert heard == [d.frame for d in virtual if d.frame.id == 0x200]
    assert 0 <= done.mean_late_ns <= done.worst_late_ns < 10 * MS
