"""Damaged logs: cut short, bits flipped, anywhere. Never a crash, a hang, or half a ride in silence."""

import random
import signal
from contextlib import contextmanager

import numpy as np
import pytest

from bench.errors import LapError
from bench.laps.files import format_of
from tests.bench.laps.can.logs import EVERY, strokes, write

CASES = 40
WORST_S = 20
WITHOUT_END = (".log", ".csv", ".trc")
"""Formats whose last line is like any other: cut at a line's end, such a file is a shorter one, and whole."""
whole_and_packed = pytest.mark.parametrize("suffix", [*EVERY, ".log.gz", ".blf.gz"])


@contextmanager
def patience():
    """Raise TimeoutError after WORST_S."""

    def ring(number, frame):
        raise TimeoutError

    before = signal.signal(signal.SIGALRM, ring)
    signal.alarm(WORST_S)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def outcome(path):
    """What a file gives: None if refused, else its recording."""
    try:
        with patience():
            return format_of(path).read(path)
    except LapError as error:
        refusal = str(error)
    assert "\n" not in refusal
    assert refusal.startswith(str(path))
    return None


def differing(one, other):
    """How many frames of `one` have no equal in `other`, or the other way round."""

    def frames(recording):
        return {
            (name, t_ns, value)
            for name, track in recording.tracks.items()
            for t_ns, value in zip(track.t_ns.tolist(), track.values.tolist(), strict=True)
        }

    return len({t_ns for _, t_ns, _ in frames(one) ^ frames(other)})


@whole_and_packed
def test_a_log_cut_short_is_refused_or_says_so(tmp_path, suffix):
    """A file that ends too early is refused, or what is left of it is read and its damage says so."""
    path = write(tmp_path / f"ride{suffix}", strokes())
    content, intact = path.read_bytes(), outcome(path)
    rng = random.Random(1)
    for at in (1, len(content) - 1, *(rng.randrange(1, len(content)) for _ in range(CASES))):
        path.write_bytes(content[:at])
        found = outcome(path)
        at_a_lines_end = suffix in WITHOUT_END and content[at - 1 : at] == b"\n"
        if found is not None and not found.damage and not at_a_lines_end:
            assert differing(found, intact) == 0, at


@whole_and_packed
def test_a_flipped_bit_costs_no_more_than_its_frame(tmp_path, suffix):
    """With a bit flipped, a file is refused, says so, is unharmed, or one frame is another.

    A bit of a payload, an identifier or a time makes one valid frame of another: no format but the packed
    ones has a checksum that would tell.
    """
    path = write(tmp_path / f"ride{suffix}", strokes())
    content, intact = path.read_bytes(), outcome(path)
    rng = random.Random(2)
    for _ in range(CASES):
        damaged = bytearray(content)
        at, bit = rng.randrange(len(content)), rng.randrange(8)
        damaged[at] ^= 1 << bit
        path.write_bytes(damaged)
        found = outcome(path)
        if found is not None and not found.damage:
            # the frame that was, and the one that it became
            assert differing(found, intact) <= 2, (at, bit)


@whole_and_packed
def test_zeros_in_the_middle_are_no_silence(tmp_path, suffix):
    """A block of zeros, as a lost sector leaves, is refused, reported, or hit nothing that counts."""
    path = write(tmp_path / f"ride{suffix}", strokes())
    content, intact = path.read_bytes(), outcome(path)
    middle = len(content) // 2
    path.write_bytes(content[:middle] + bytes(100) + content[middle + 100 :])
    found = outcome(path)
    assert found is None or found.damage or differing(found, intact) == 0


@whole_and_packed
@pytest.mark.parametrize("junk", [b"\0" * 999, bytes(range(256)) * 8, b"\n" * 999, b"t_s,fork\n0,1\n"])
def test_what_is_no_log_is_refused(tmp_path, suffix, junk):
    """Bytes of no format are refused in one line, whatever the suffix says."""
    path = tmp_path / f"ride{suffix}"
    path.write_bytes(junk)
    assert outcome(path) is None


def test_the_comparison_sees_a_difference(tmp_path):
    """The measure of these tests tells a ride from one with a frame less."""
    long = outcome(write(tmp_path / "a.log", strokes()))
    short = outcome(write(tmp_path / "b.log", strokes(count=49)))
    assert differing(long, short) == 1
    assert np.array_equal(long.tracks["fork_stroke_mm"].t_ns[:49], short.tracks["fork_stroke_mm"].t_ns)
