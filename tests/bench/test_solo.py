"""One ECU alone: on a timed bus, on a live one, looked at while it runs."""

from itertools import pairwise

import pytest

from bench.bus.timed import EXTENDED, TimedBus
from bench.errors import BusError
from bench.solo import Sent, Tally, Watched, run, run_live
from targets.ecu import Frame, Transmission

MS = 1_000_000


class Beats:
    """Asks for a frame each millisecond, the next one when the last was sent."""

    name = "beats"

    def __init__(self, extended: bool = False) -> None:
        self.due_ns, self.busy, self.reached, self.done = MS, False, [], []
        self.extended = extended

    def advance(self, t_ns):
        self.reached.append(t_ns)
        if self.busy or self.due_ns > t_ns:
            return None
        self.busy = True
        return Transmission(self.due_ns, 5, Frame(0x77, self.due_ns.to_bytes(8, "big"), self.extended))

    def receive(self, frame, t_ns):
        raise AssertionError("there is nobody to hear")

    def sent(self, handle, t_ns):
        self.done.append((handle, t_ns))
        self.busy, self.due_ns = False, self.due_ns + MS

    def where(self):
        return "here"


@pytest.mark.parametrize("extended", [False, True])
def test_frames_are_sent_and_counted(extended):
    """All that is asked for goes over the bus, is reported back, and is in the tally by its identifier."""
    ecu, tally = Beats(extended), Tally()
    run(ecu, TimedBus(500_000), 10 * MS, tally)
    assert list(tally.by_id) == [0x77 | EXTENDED if extended else 0x77]
    row = tally.by_id[0x77 | EXTENDED if extended else 0x77]
    assert row.frames == len(ecu.done) == 9  # the tenth would end behind the end
    assert row.period_ns == pytest.approx(MS, abs=20_000)
    assert row.data == (9 * MS).to_bytes(8, "big")
    assert (row.first_ns, row.last_ns) == (ecu.done[0][1], ecu.done[-1][1])
    assert {handle for handle, _ in ecu.done} == {5}
    assert max(ecu.reached) == 10 * MS


def test_one_frame_has_no_period():
    """A period takes two frames."""
    assert Sent(1, 5, 5, b"").period_ns is None


def test_many_frames_one_after_the_other_are_no_flood():
    """What has been sent does not wait any more."""
    tally = Tally()
    run(Beats(), TimedBus(500_000), 100 * MS, tally)
    assert tally.by_id[0x77].frames == 99


def test_flood_is_refused():
    """An ECU that asks without end ends the run, by name."""

    class Flood(Beats):
        def advance(self, t_ns):
            return Transmission(t_ns, 0, Frame(1, b""))

    with pytest.raises(BusError, match="beats floods the bus: 65 frames wait"):
        run(Flood(), TimedBus(), 10 * MS, Tally())


def test_watched_ecu_is_looked_at_in_time():
    """However far it is to run, it is looked at each so often, and what it asks for comes through."""
    looks = []
    watched = Watched(Beats(), looks.append, MS // 2)
    assert watched.advance(0) is None
    assert watched.advance(10 * MS).t_ns == MS
    watched.sent(5, MS)
    assert watched.advance(10 * MS).t_ns == 2 * MS
    assert looks == [0, MS // 2, MS, 3 * MS // 2, 2 * MS]
    assert (watched.name, watched.where()) == ("beats", "here")


def test_looking_changes_nothing():
    """However often it is looked at, an ECU sends the same at the same instants, and is looked at in time."""
    looks, plain, watched = [], Tally(), Tally()
    run(Beats(), TimedBus(), 20 * MS, plain)
    run(Beats(), TimedBus(), 20 * MS, watched, looks.append, 123_457)
    assert plain == watched
    assert all(b - a <= 123_457 for a, b in pairwise([0, *looks]))
    assert looks[-1] == 20 * MS


def test_live_bus_is_counted():
    """On a live bus what is sent is counted at the clock's instants."""

    class Bus:
        echoes, refusal = False, ""

        def send(self, frame, timeout_s):
            self.last = frame
            return True

        def receive(self, timeout_s):
            clock.now += 500_000

    class Clock:
        now = 7 * MS

        def __call__(self):
            return self.now

    clock, tally = Clock(), Tally()
    run_live(Beats(), Bus(), tally, seconds=0.01, clock=clock)
    assert tally.by_id[0x77].frames == 10
    assert tally.by_id[0x77].first_ns == MS
    assert tally.by_id[0x77].last_ns == 10 * MS
