"""Records: what is one, what is none, and what a hub makes of a client's bytes."""

from itertools import count

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.bus.hub import wire


@st.composite
def frames(draw):
    """A frame's record as a client sends it."""
    flags = draw(
        st.sampled_from([0, wire.EXTENDED, wire.REMOTE, wire.FD, wire.FD | wire.BRS | wire.ESI, wire.ERROR])
    )
    identifier = draw(st.integers(0, (1 << 29 if flags & wire.EXTENDED else 1 << 11) - 1))
    dlc = draw(st.sampled_from(sorted(wire.FD_LENGTHS)) if flags & wire.FD else st.integers(0, 8))
    body = b"" if flags & wire.REMOTE else draw(st.binary(min_size=dlc, max_size=dlc))
    return wire.pack(wire.FRAME, flags, dlc, identifier, 0, body)


@given(st.lists(frames(), max_size=5), st.integers(0, 79))
def test_stamped_once_each(records, cut):
    """Every whole frame gets a time of its own and nothing else; a beginning waits for its end."""
    more = wire.pack(wire.FRAME, wire.FD, 64, 1, 0, bytes(64))[:cut]
    buffer = bytearray(b"".join(records) + more)
    end = wire.stamp(buffer, count(10).__next__)
    assert buffer[end:] == more
    stamped = [record for _, record in wire.whole(buffer[:end])]
    assert [record.t_ns for record in stamped] == list(range(10, 10 + len(records)))
    assert [wire.pack(*record._replace(t_ns=0)) for record in stamped] == records


@given(st.binary(max_size=200))
def test_any_bytes(data):
    """Whatever bytes come, they are frames, the beginning of one, or a WireError."""
    buffer = bytearray(data)
    try:
        end = wire.stamp(buffer, lambda: 0)
    except wire.WireError:
        return
    assert len(buffer) == len(data)
    assert len(buffer) - end < wire.LONGEST


@given(st.lists(frames(), max_size=4))
def test_own_marks_and_changes_nothing_else(records):
    """The sender's copy differs in the one flag only."""
    batch = b"".join(records)
    for (_, mine), (_, theirs) in zip(wire.whole(wire.own(batch)), wire.whole(batch), strict=True):
        assert mine == theirs._replace(flags=theirs.flags | wire.OWN)


@pytest.mark.parametrize(
    ("record", "says"),
    [
        ((0, 0, 0x800), "identifier 0x800 has more than 11 bits"),
        ((wire.EXTENDED, 0, 1 << 29), "identifier 0x20000000 has more than 29 bits"),
        ((0, 9, 1, 0, bytes(9)), "a classic frame has no 9 bytes"),
        ((0, 9, 1), "a classic frame has no 9 bytes"),
        ((0, 3, 1, 0, b"ab"), "2 bytes of data at DLC 3"),
        ((wire.REMOTE, 2, 1, 0, b"ab"), "2 bytes of data at DLC 2"),
        ((wire.FD, 9, 1, 0, bytes(9)), "an FD frame has no 9 bytes"),
        ((wire.FD | wire.REMOTE, 0, 1), "neither a remote nor an error frame"),
        ((wire.BRS, 0, 1), "only an FD frame has BRS or ESI"),
        ((wire.OWN, 0, 1), "a record of kind 3, flags 0x40 and 16 bytes, which is no frame"),
        ((0x80, 0, 1), "a record of kind 3, flags 0x80"),
    ],
)
def test_frame_that_is_none(record, says):
    """What no bus can carry is refused, with the value."""
    with pytest.raises(wire.WireError, match=says):
        wire.stamp(bytearray(wire.pack(wire.FRAME, *record)), lambda: 0)


def test_length_that_is_none():
    """A length shorter than the head is refused, not looped over."""
    for length in (0, 15):
        record = bytearray(wire.pack(wire.HELLO))
        record[0] = length
        with pytest.raises(wire.WireError, match=f"a record of {length} bytes"):
            list(wire.whole(record))


def test_long_words_are_cut():
    """A notice fits its record."""
    (_, record), *_ = wire.whole(wire.notice(wire.REFUSED, "x" * 1000))
    assert wire.text(record) == "x" * 239
