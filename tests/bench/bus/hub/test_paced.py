"""Frames of a hub on the timed bus: priority between senders, order within one, the bit rate's pace."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.bus.bits import frame_bits
from bench.bus.hub import wire
from bench.bus.hub.exchange import Exchange
from bench.bus.hub.paced import DEPTH, Paced
from bench.errors import BusError

MS = 1_000_000


def frame(identifier, data=b"", flags=0):
    return wire.pack(wire.FRAME, flags, len(data), identifier, 0, data)


def carried(paced, until_ns=10_000 * MS):
    """Sender, end and identifier of what the bus carries."""
    return [(who, t_ns, next(wire.whole(record))[1].id) for who, t_ns, record in paced.run(until_ns)]


def test_priority_between_senders():
    """While the bus is busy, frames gather; then the lowest identifier is next, whoever came first."""
    paced = Paced(500_000)
    for who, identifier in (("a", 0x300), ("b", 0x200), ("c", 0x100)):
        assert not list(paced.put(who, frame(identifier), len(who)))
        if who == "a":
            carried(paced, 1)  # its frame has started
    assert [(who, identifier) for who, _, identifier in carried(paced)] == [
        ("a", 0x300),
        ("c", 0x100),
        ("b", 0x200),
    ]


def test_order_within_a_sender():
    """One sender's frames go in the order in which they were sent, also against their priority."""
    paced = Paced(500_000)
    list(paced.put("a", frame(3) + frame(2) + frame(1), 0))
    list(paced.put("b", frame(2), 0))
    assert [(who, identifier) for who, _, identifier in carried(paced)] == [
        ("b", 2),
        ("a", 3),
        ("a", 2),
        ("a", 1),
    ]


@given(st.lists(st.tuples(st.integers(0, 3), st.integers(0, 3), st.binary(max_size=8)), max_size=30))
def test_nothing_is_lost(sends):
    """Any frames of any senders, equal identifiers too, all end, back to back, each sender's in order."""
    paced, bits = Paced(250_000), 0
    for who, identifier, data in sends:
        list(paced.put(who, frame(identifier, data), 0))
        bits += frame_bits(identifier, data) + 3
    done = list(paced.run(10_000 * MS))
    for who in range(4):
        sent = [(identifier, data) for sender, identifier, data in sends if sender == who]
        got = [next(wire.whole(record))[1] for sender, _, record in done if sender == who]
        assert [(record.id, record.body) for record in got] == sent
    if done:
        assert done[-1][1] == (bits - 3) * 4000
    assert paced.due_ns() is None


def test_time_on_the_bus():
    """A frame arrives when its last bit has gone, with that time, at every member; not before."""
    made = Exchange(lambda: 0, 1, Paced(500_000), lambda: 5_000_000 * MS)
    sender, other = made.join("a", True), made.join("b", False)
    made.take(sender, frame(0x123, b"\x55" * 8), 0)
    end_ns = frame_bits(0x123, b"\x55" * 8) * 2000
    made.run(end_ns - 1)
    assert not other.out
    made.run(end_ns - 1)
    assert made.due_ns() == end_ns
    made.run(end_ns + 7)
    times = [record.t_ns for member in (sender, other) for _, record in wire.whole(member.out)]
    assert times == [5_000_000 * MS + end_ns] * 2


def test_depth():
    """A sender has room for so many frames that wait."""
    paced = Paced(500_000)
    list(paced.put("a", frame(1) * (DEPTH - 1), 0))
    assert paced.has_room("a")
    list(paced.put("a", frame(1), 0))
    assert not paced.has_room("a")
    assert paced.has_room("b")
    assert len(carried(paced)) == DEPTH
    assert paced.has_room("a")


def test_error_frame_takes_no_time():
    """An error frame is handed on at once."""
    record = frame(0x20, bytes(8), wire.ERROR)
    assert list(Paced(500_000).put("a", record, 0)) == [record]


def test_fd_frame():
    """FD frames have no place on it."""
    with pytest.raises(wire.WireError, match="a timed bus carries no FD frames"):
        list(Paced(500_000).put("a", frame(1, bytes(12), wire.FD), 0))


@pytest.mark.parametrize("bitrate", [-1, 1_000_001])
def test_bit_rate_that_is_none(bitrate):
    """The timed bus's own range holds."""
    with pytest.raises(BusError, match=f"bit rate {bitrate} bit/s"):
        Paced(bitrate)
