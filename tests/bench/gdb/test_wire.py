"""Packets of GDB's remote protocol: what is framed comes back, what is damaged is said to be."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.gdb.wire import LIMIT, Decoder, Mark, Packet, encode


def test_known_packet():
    """The manual's own framing: $ data # two digits of the sum of the bytes."""
    assert encode(b"OK") == b"$OK#9a"
    assert Decoder().feed(b"$OK#9a") == [Packet(b"OK")]


def test_reserved_bytes_are_escaped():
    """#, $, }, and * for the sake of run lengths, travel as } and the byte xor 0x20."""
    assert encode(b"}")[1:3] == b"}\x5d"
    assert encode(b"#$*")[1:7] == b"}\x03}\x04}\x0a"


@given(st.lists(st.binary(max_size=80), max_size=5), st.data())
def test_any_payload_in_any_pieces(payloads, data):
    """Whatever is encoded is decoded, however the bytes are cut into pieces."""
    line = b"".join(encode(payload) for payload in payloads)
    decoder, events = Decoder(), []
    while line:
        cut = data.draw(st.integers(1, len(line)))
        events += decoder.feed(line[:cut])
        line = line[cut:]
    assert events == [Packet(payload) for payload in payloads]


@given(st.lists(st.binary(max_size=40)))
def test_any_bytes(pieces):
    """Noise raises nothing, and a whole packet after it is read."""
    decoder = Decoder()
    for piece in pieces:
        decoder.feed(piece)
    assert decoder.feed(b"#00" + encode(b"g"))[-1] == Packet(b"g")


@pytest.mark.parametrize(
    "line",
    [b"$OK#9b", b"$OK#zz", b"$OK}#17", b"$g$#24"],
    ids=["sum", "digits", "escape of nothing", "second $"],
)
def test_damaged(line):
    """A wrong sum, a sum that is no number, an escape of nothing and an unescaped $ damage a packet."""
    assert Decoder().feed(line)[0] is Mark.DAMAGED


def test_packet_after_a_lost_end():
    """A packet whose end was lost does not take the next one with it."""
    assert Decoder().feed(b"$m0,4$g#67") == [Mark.DAMAGED, Packet(b"g")]


def test_endless_packet():
    """A packet without an end is given up, not kept for ever."""
    decoder = Decoder()
    assert decoder.feed(b"$" + b"0" * (LIMIT + 1)) == [Mark.DAMAGED]
    assert decoder.feed(b"000#00$g#67") == [Packet(b"g")]


def test_marks_between_packets():
    """Acknowledgements and the interrupt byte are heard between packets; inside one it is data."""
    assert Decoder().feed(b"+-\x03" + encode(b"X0,1:\x03")) == [
        Mark.ACK,
        Mark.NAK,
        Mark.INTERRUPT,
        Packet(b"X0,1:\x03"),
    ]
