"""The hub without sockets: one order, one time, echoes, and who waits for whom."""

from itertools import count

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.bus.hub import wire
from bench.bus.hub.exchange import Exchange

S = 1_000_000_000


def frame(identifier, data=b""):
    return wire.pack(wire.FRAME, 0, len(data), identifier, 0, data)


def records(member):
    return [record for _, record in wire.whole(member.out)]


def heard(member):
    """Identifiers and times of the frames in a member's queue."""
    return [(record.id, record.t_ns) for record in records(member) if record.kind == wire.FRAME]


def notices(member):
    return [wire.text(record) for record in records(member) if record.kind != wire.FRAME]


def exchange(members=3, queue_bytes=1 << 20, own=False):
    made = Exchange(count(1).__next__, 5 * S, queue_bytes=queue_bytes)
    return made, [made.join(f"client {number}", own) for number in range(members)]


@given(st.lists(st.tuples(st.integers(0, 2), st.binary(max_size=8)), max_size=20), st.integers(1, 20))
def test_one_order_and_one_time(sends, chunk):
    """Whoever sends, in whatever pieces: all others hear everything, in one order, with one time."""
    made, members = exchange()
    everything = made.join("listener", False)
    for number, (sender, data) in enumerate(sends):
        record = frame(number, data)
        for at in range(0, len(record), chunk):
            made.take(members[sender], record[at : at + chunk], 0)
    assert heard(everything) == [(number, number + 1) for number in range(len(sends))]
    for index, member in enumerate(members):
        assert heard(member) == [
            (number, number + 1) for number, (sender, _) in enumerate(sends) if sender != index
        ]


def test_own_frames():
    """Who asks for it hears its own frames, marked, in their place among the others."""
    made, (asks, other) = exchange(2, own=True)
    made.take(asks, frame(1), 0)
    made.take(other, frame(2), 0)
    assert [(record.id, record.flags) for record in records(asks)] == [(1, wire.OWN), (2, 0)]
    assert [(record.id, record.flags) for record in records(other)] == [(1, 0), (2, wire.OWN)]


def test_full_queue_holds_everybody_up():
    """One full queue stops the taking, everybody is told whose it is, and half of it free ends that."""
    made, (sender, slow, other) = exchange(queue_bytes=100)
    made.take(sender, frame(1) * 6, 0)
    assert not made.held_up
    assert made.takes_from(sender)
    other.out.clear()
    made.take(sender, frame(2), 0)
    assert made.held_up
    assert not made.takes_from(sender)
    assert notices(other) == ["client 1"]
    made.went(slow, len(slow.out) - 51, 0)
    assert made.held_up
    made.went(slow, 1, 0)
    assert not made.held_up
    assert notices(sender) == ["client 1", ""]


def test_who_reads_nothing_is_put_off():
    """After the patience the slow one gets the frames taken so far and one word, and the others go on."""
    made, (sender, slow) = exchange(2, queue_bytes=100)
    made.take(sender, frame(1) * 7, 2 * S)
    assert made.due_ns() == 7 * S
    made.run(7 * S - 1)
    assert made.held_up
    made.run(7 * S)
    assert not made.held_up
    assert made.due_ns() is None
    made.take(sender, frame(2), 7 * S)
    assert [identifier for identifier, _ in heard(slow)] == [1] * 7
    assert notices(slow)[-1].startswith("client 1 read nothing for 5 s while ")
    assert not made.takes_from(slow)


def test_who_reads_slowly_is_not_put_off():
    """Patience counts from the last byte that went."""
    made, (sender, slow) = exchange(2, queue_bytes=100)
    made.take(sender, frame(1) * 7, 0)
    made.went(slow, 1, 4 * S)
    made.run(5 * S)
    assert made.held_up
    assert made.due_ns() == 9 * S


@pytest.mark.parametrize("way", [Exchange.leave, Exchange.deafen])
def test_who_leaves_holds_nobody_up(way):
    """A full queue goes with its owner."""
    made, (sender, slow, other) = exchange(queue_bytes=100)
    made.take(sender, frame(1) * 7, 0)
    made.went(other, len(other.out), 0)
    way(made, slow)
    assert made.takes_from(sender)
    made.take(sender, frame(2), 0)
    assert not heard(slow) or way is Exchange.leave
    assert [identifier for identifier, _ in heard(other)] == [2]


def test_the_deaf_can_speak():
    """What a member has sent before it closed its ears still goes to the others."""
    made, (gone, other) = exchange(2)
    made.deafen(gone)
    made.take(gone, frame(5), 0)
    assert heard(other) == [(5, 1)]
