"""The length of a frame, against hand-counted frames, a slow reference and the published bounds."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.bus.bits import frame_bits


def crc15(bits):
    """The remainder of bits * x^15 by the polynomial x^15+x^14+x^10+x^8+x^7+x^4+x^3+1, by long division."""
    divisor = [1, 1, 0, 0, 0, 1, 0, 1, 1, 0, 0, 1, 1, 0, 0, 1]
    rest = [*bits, *[0] * 15]
    for k in range(len(bits)):
        if rest[k]:
            for j, d in enumerate(divisor):
                rest[k + j] ^= d
    return rest[-15:]


def reference_bits(identifier, data, extended):
    """The frame written out as text, stuffed by one pass over it."""
    if extended:
        ident = f"{identifier:029b}"
        text = "0" + ident[:11] + "11" + ident[11:] + "000"
    else:
        text = "0" + f"{identifier:011b}" + "000"
    text += f"{len(data):04b}" + "".join(f"{byte:08b}" for byte in data)
    text += "".join(map(str, crc15([int(c) for c in text])))
    sent = ""
    for bit in text:
        sent += bit
        if len(sent) >= 5 and sent[-5:] in ("00000", "11111"):
            sent += "1" if bit == "0" else "0"
    return len(sent) + 10


frames = st.booleans().flatmap(
    lambda extended: st.tuples(
        st.integers(0, (1 << (29 if extended else 11)) - 1) | st.sampled_from([0, 0x7FF]),
        # long runs of equal bits are where stuffing goes wrong
        st.lists(st.integers(0, 255) | st.sampled_from([0, 255, 0x0F, 0x78]), max_size=8).map(bytes),
        st.just(extended),
    )
)


@given(frames)
def test_against_reference(frame):
    """The kernel counts the bits that a frame written out bit by bit has."""
    assert frame_bits(*frame) == reference_bits(*frame)


@pytest.mark.parametrize(
    ("identifier", "data", "extended", "bits"),
    [
        # 19 zeros and a CRC of zeros: a stuff bit after every fifth of 34, none of which joins a run
        (0x000, b"", False, 44 + 6),
        # 7 zeros after 0x555's last one, CRC 110011101001100
        (0x555, b"", False, 44 + 1),
        # 13 zeros (2), then 16 ones and the CRC's 1 (3), CRC 100011001001001
        (0x100, b"\xff\xff", False, 44 + 16 + 5),
        # 12 zeros (2), SRR and IDE, 25 zeros (5), CRC 100011000010000
        (0x00000000, b"", True, 64 + 7),
    ],
)
def test_known_frames(identifier, data, extended, bits):
    """Frames whose stuff bits can be counted by hand have that many."""
    assert frame_bits(identifier, data, extended) == bits


def shortest_bits(length, extended=False):
    """Of a frame of `length` data bytes that needs no stuff bit."""
    return 8 * length + (64 if extended else 44)


def longest_bits(length, extended=False):
    """With a stuff bit after every fourth bit: floor((34 + 8n - 1) / 4) more, or 54."""
    return shortest_bits(length, extended) + ((54 if extended else 34) + 8 * length - 1) // 4


@given(frames)
def test_bounds(frame):
    """No frame is shorter than 8n + 44 bits, or 8n + 64, nor longer than the worst stuffing makes it."""
    _, data, extended = frame
    assert shortest_bits(len(data), extended) <= frame_bits(*frame) <= longest_bits(len(data), extended)


def test_published_bounds():
    """The bounds of 8 data bytes are the well-known 108 and 132 bits, of extended frames 128 and 157."""
    assert (shortest_bits(8), longest_bits(8)) == (108, 132)
    assert (shortest_bits(8, True), longest_bits(8, True)) == (128, 157)
