"""The bus in virtual time: priority, waiting, exact instants, refusals, statistics."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.bus.bits import frame_bits
from bench.bus.timed import EXTENDED, TimedBus
from bench.errors import BusError
from targets.ecu import Frame

BIT = 2000  # ns at 500 kbit/s
FOREVER = 10**15


def frame(identifier, data=b"\x55", extended=False):
    return Frame(identifier, data, extended)


def ids(delivered):
    return [d.frame.id for d in delivered]


def test_one_frame():
    """A frame on an idle bus starts at once and ends after its bits."""
    bus = TimedBus()
    bus.submit(7000, "a", 42, frame(0x100))
    bits = frame_bits(0x100, b"\x55")
    done = bus.step(FOREVER)
    assert done == (7000, 7000 + bits * BIT, "a", 42, frame(0x100), bits)
    assert bus.step(FOREVER) is None
    assert bus.next_decision_ns() is None


def test_priority_among_pending():
    """Of the frames pending together the lowest identifier goes first, whoever sends it."""
    bus = TimedBus()
    for handle, identifier in enumerate((0x300, 0x100, 0x200)):
        bus.submit(0, f"n{handle}", handle, frame(identifier))
    assert ids(bus.advance(FOREVER)) == [0x100, 0x200, 0x300]


def test_no_preemption():
    """A frame of higher priority that comes during a transmission waits for its end."""
    bus = TimedBus()
    bus.submit(0, "a", 0, frame(0x700))
    bus.submit(BIT, "b", 1, frame(0x001))
    first, second = bus.advance(FOREVER)
    assert (first.frame.id, second.frame.id) == (0x700, 0x001)
    assert second.t_start_ns == first.t_end_ns + 3 * BIT


@pytest.mark.parametrize(("offset", "expected"), [(0, [0x700, 0x001, 0x300]), (1, [0x700, 0x300, 0x001])])
def test_latest_entry_into_arbitration(offset, expected):
    """A frame submitted at the instant of an arbitration takes part in it; a nanosecond later it does not."""
    bus = TimedBus()
    bus.submit(0, "a", 0, frame(0x700))
    bus.submit(BIT, "b", 1, frame(0x300))
    end = frame_bits(0x700, b"\x55") * BIT
    bus.submit(end + 3 * BIT + offset, "c", 2, frame(0x001))
    assert ids(bus.advance(FOREVER)) == expected


def test_a_node_can_answer_between_the_decisions():
    """Stepped decision by decision, a node that answers a frame takes part in the next arbitration."""
    bus = TimedBus()
    bus.submit(0, "logger", 0, frame(0x100))
    bus.submit(0, "logger", 1, frame(0x102))
    order = []
    while (now := bus.next_decision_ns()) is not None:
        done = bus.step(now)
        if done is not None:
            assert done.t_end_ns == now
            order.append(done.frame.id)
            if done.frame.id == 0x100:
                bus.submit(now + 3 * BIT, "ecu", 2, frame(0x101))
    assert order == [0x100, 0x101, 0x102]


def test_step_stops_in_time():
    """A step delivers nothing that ends after its limit, and takes no decision after it."""
    bus = TimedBus()
    bus.submit(0, "a", 0, frame(0x100))
    end = frame_bits(0x100, b"\x55") * BIT
    assert bus.step(end - 1) is None
    assert bus.next_decision_ns() == end
    bus.submit(end - 1, "b", 1, frame(0x050))
    done = bus.step(end)
    assert done is not None
    assert done.t_end_ns == end
    assert bus.next_decision_ns() == end + 3 * BIT


def test_standard_before_extended():
    """At the same base identifier the standard frame wins; otherwise the base identifier decides."""
    bus = TimedBus()
    bus.submit(0, "a", 0, frame(0x100 << 18, extended=True))
    bus.submit(0, "b", 1, frame(0x100))
    bus.submit(0, "c", 2, frame(0x101))
    bus.submit(0, "d", 3, frame((0x0FF << 18) + 5, extended=True))
    bus.submit(0, "e", 4, frame((0x0FF << 18) + 4, extended=True))
    assert [d.node for d in bus.advance(FOREVER)] == ["e", "d", "b", "a", "c"]


def test_same_identifier_from_two_nodes():
    """Two nodes that start the same identifier at once are an error that names both."""
    bus = TimedBus()
    bus.submit(0, "mdlog", 0, frame(0x100))
    bus.submit(0, "ecu", 1, frame(0x100, b"\x01"))
    with pytest.raises(BusError, match="mdlog and ecu send identifier 0x100 at once"):
        bus.step(FOREVER)


def test_same_identifier_apart_in_time():
    """Two nodes may use one identifier as long as they do not start together."""
    bus = TimedBus()
    bus.submit(0, "mdlog", 0, frame(0x100))
    bus.submit(1, "ecu", 1, frame(0x100))
    assert [d.node for d in bus.advance(FOREVER)] == ["mdlog", "ecu"]


def test_one_node_queues_in_order():
    """Frames of one node with one identifier go out in the order of submission."""
    bus = TimedBus()
    for handle in range(5):
        bus.submit(0, "a", handle, frame(0x100))
    assert [d.handle for d in bus.advance(FOREVER)] == [0, 1, 2, 3, 4]


@given(st.integers(1, 1_000_000), st.lists(st.binary(max_size=8), min_size=1, max_size=20))
def test_exact_at_any_bit_rate(bitrate, payloads):
    """At any bit rate the instants of back-to-back frames are the bit counts rounded once, never summed."""
    bus = TimedBus(bitrate)
    for handle, data in enumerate(payloads):
        bus.submit(5, "a", handle, frame(0x123, data))
    count = 0
    for done in bus.advance(10**18):
        assert abs((done.t_start_ns - 5) * bitrate - count * 10**9) * 2 <= bitrate
        count += done.bits
        assert abs((done.t_end_ns - 5) * bitrate - count * 10**9) * 2 <= bitrate
        count += 3


requests = st.lists(
    st.tuples(st.integers(0, 2_000_000), st.integers(0, 0x7FF), st.binary(max_size=8)),
    min_size=1,
    max_size=25,
)


@given(requests, st.lists(st.integers(0, 4_000_000), max_size=6))
def test_laws_of_the_bus(wanted, pauses):
    """Every frame is sent once, none overlaps another, each start is the best choice of those waiting."""
    bus = TimedBus()
    for handle, (t_ns, identifier, data) in enumerate(wanted):
        bus.submit(t_ns, "n", handle, frame(identifier, data))
    # however the caller steps, the outcome is the same
    sent = [done for pause in sorted(pauses) for done in bus.advance(pause)] + bus.advance(FOREVER)
    assert sorted(done.handle for done in sent) == list(range(len(wanted)))
    waiting = dict(enumerate(wanted))
    free = 0
    for done in sent:
        assert done.t_start_ns == max(free, min(t_ns for t_ns, _, _ in waiting.values()))
        rivals = [identifier for t_ns, identifier, _ in waiting.values() if t_ns <= done.t_start_ns]
        assert done.frame.id == min(rivals)
        assert done.t_end_ns == done.t_start_ns + done.bits * BIT
        free = done.t_end_ns + 3 * BIT
        del waiting[done.handle]


def test_statistics():
    """The load counts bits, busy time with intermissions, frames and the worst wait of each identifier."""
    bus = TimedBus()
    bus.submit(0, "a", 0, frame(0x100))
    bus.submit(0, "b", 1, frame(0x200, b""))
    bus.submit(10**6, "b", 2, frame(0x200, b""))
    bus.submit(10**6, "c", 3, frame(0x200 << 18, b"", extended=True))
    first, second, third, fourth = bus.advance(FOREVER)
    load = bus.load(2 * 10**6)
    assert load.bits == sum(d.bits for d in (first, second, third, fourth))
    assert load.busy_ns == (load.bits + 4 * 3) * BIT
    assert load.load == load.busy_ns / (2 * 10**6)
    assert (third.t_start_ns, fourth.frame.extended) == (10**6, True)
    assert load.by_id == {
        0x100: (1, 0),
        0x200: (2, second.t_start_ns),
        0x200 << 18 | EXTENDED: (1, fourth.t_start_ns - 10**6),
    }
    assert TimedBus().load(0).load == 0.0


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        (frame(0x800), "identifier 0x800 has more than 11 bits"),
        (frame(1 << 29, extended=True), "more than 29 bits"),
        (frame(-1), "identifier"),
        (frame(0x100, b"123456789"), "0x100 has 9 bytes, more than 8"),
    ],
)
def test_frames_that_are_none(wrong, says):
    """What does not fit a classic CAN frame is refused, and the node is named."""
    with pytest.raises(BusError, match=f"ecu: .*{says}"):
        TimedBus().submit(0, "ecu", 0, wrong)


def test_the_past_is_decided():
    """A request for an instant before the last decision is refused: it would have taken part in it."""
    bus = TimedBus()
    bus.submit(1000, "a", 0, frame(0x100))
    assert bus.step(2000) is None
    bus.submit(1000, "b", 1, frame(0x050))
    with pytest.raises(BusError, match="b asks at 999 ns to send 0x50; the bus is at 1000 ns already"):
        bus.submit(999, "b", 2, frame(0x050))


@pytest.mark.parametrize("bitrate", [0, -500_000, 1_000_001])
def test_bit_rate(bitrate):
    """A bit rate that classic CAN does not have is refused with the value."""
    with pytest.raises(BusError, match=f"bit rate {bitrate} bit/s"):
        TimedBus(bitrate)
