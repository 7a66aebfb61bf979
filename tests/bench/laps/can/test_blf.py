"""Vector's .blf: containers and objects that a damaged file could use against its reader."""

import struct
import zlib

import can
import pytest

from bench.errors import LapError
from bench.laps.can.blf import parse, read
from tests.bench.laps.can.logs import FRAMES, strokes, write


def container(body, method=2, size=None):
    """One log container of `body`, deflated or stored."""
    packed = zlib.compress(body) if method == 2 else body
    inner = struct.pack("<H6xL4x", method, len(body) if size is None else size) + packed
    whole = struct.pack("<4sHHLL", b"LOBJ", 16, 1, 16 + len(inner), 10) + inner
    return whole + bytes(len(whole) % 4)


def message(k, identifier=0x100, size=48, kind=86, version=1, flags=2):
    """One CAN message at k times 10 ms."""
    head = struct.pack("<4sHHLL", b"LOBJ", 32, version, size, kind) + struct.pack(
        "<LHHQ", flags, 0, 0, k * 10_000_000
    )
    return head + struct.pack("<HBBL8s", 1, 0, 4, identifier, bytes([k, 0, 0, 0]))


def blf(*parts, objects=None, size=None):
    """A file of these containers or objects, its header counting `objects`."""
    body = b"".join(parts)
    count = objects if objects is not None else 3
    size = 144 + len(body) if size is None else size
    return struct.pack("<4sL8BQQLL", b"LOGG", 144, *[0] * 8, size, 0, count, 0).ljust(144, b"\0") + body


THREE = b"".join(message(k) for k in range(3))


def test_objects_may_lie_across_containers():
    """What begins in one container goes on in the next, wherever the cut is."""
    for cut in range(len(THREE)):
        frames = parse(blf(container(THREE[:cut]), container(THREE[cut:], method=0)), "a.blf")
        assert frames.t_ns.tolist() == [0, 10_000_000, 20_000_000]
        assert frames.damage == ()


def test_objects_outside_of_containers_are_read():
    """What an old logger wrote without containers is read like the rest."""
    assert len(parse(blf(container(message(0)), message(1), message(2)), "a.blf")) == 3


def test_coarse_time_stamps_are_tens_of_microseconds():
    """An object that counts in 10 us is read so."""
    assert parse(blf(container(message(1, flags=1)), objects=1), "a.blf").t_ns.tolist() == [100_000_000_000]


def test_a_long_log_is_read_whole(tmp_path):
    """A log of several containers by python-can's writer gives every frame to the nanosecond."""
    path = tmp_path / "a.blf"
    with can.BLFWriter(path) as writer:
        for k in range(10_000):
            writer.on_message_received(
                can.Message(timestamp=k / 1000, arbitration_id=0x100, data=b"1234", is_extended_id=False)
            )
    frames = parse(path.read_bytes(), "a.blf")
    assert (len(frames), frames.damage) == (10_000, ())
    assert set(frames.bus) == {1}


def test_a_log_cut_short_says_how_much_is_there(tmp_path):
    """Half a file is read as far as it goes; the damage gives bytes and objects."""
    path = tmp_path / "a.blf"
    with can.BLFWriter(path, compression_level=0) as writer:
        for entry in strokes():
            writer.on_message_received(entry)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    recording = read(path)
    left = len(recording.tracks["fork_stroke_mm"].t_ns)
    assert 0 < left < FRAMES
    assert recording.damage[0] == f"cut short: {len(whole) // 2} of {len(whole)} bytes"
    assert recording.damage[-1] == f"{left} of the {FRAMES} objects that its header counts"


def test_a_log_that_was_not_closed_says_so():
    """A header that counts fewer objects than there are was never written to the end."""
    frames = parse(blf(container(THREE), objects=0), "a.blf")
    assert (len(frames), frames.damage) == (3, ("not closed: its header counts 0 objects, 3 are there",))


def test_other_objects_are_counted_and_passed_over():
    """An object that is no CAN frame counts for the header, and is no frame."""
    frames = parse(blf(container(message(0) + message(1, kind=65) + message(2))), "a.blf")
    assert (frames.at.tolist(), frames.damage) == ([1, 3], ())


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"LOGG", "not a BLF file"),
        (b"LOGF" + bytes(200), "not a BLF file"),
        (blf(container(THREE)).replace(struct.pack("<L", 144), struct.pack("<L", 8), 1), "header of 8 bytes"),
        (blf(b"garbage, and more of it"), "byte 144: no object"),
        (blf(struct.pack("<4sHHLL", b"LOBJ", 16, 1, 0, 10) + bytes(100)), "byte 144: no object"),
        (blf(container(THREE, method=7)), "byte 144: a container packed by method 7"),
        (blf(container(THREE, size=100)), "byte 144: a container of 101 bytes, not 100"),
        (blf(container(THREE, size=200)), "byte 144: a container of 144 bytes, not 200"),
        (blf(container(THREE).replace(b"\x78\x9c", b"\x79\x9d")), "byte 144: a container does not unpack"),
        (blf(container(THREE, size=0xFFFFFFFF)), "unpacks to more than"),
        (
            blf(container(message(0) + message(1, size=0) + message(2))),
            "object 2: type 86, header 1, 0 bytes",
        ),
        (
            blf(container(message(0) + message(1, size=40) + message(2))),
            "object 2: type 86, header 1, 40 bytes",
        ),
        (blf(container(message(0) + message(1, version=9) + message(2))), "object 2: type 86, header 9"),
        (blf(container(message(0) + bytes(9) + message(1))), "object 2: no object after 48 unpacked bytes"),
        (blf(container(message(0, identifier=0x900))), "object 1: identifier 0x900 is beyond 0x7ff"),
        (blf(), "0 of the 3 objects that its header counts"),
    ],
)
def test_what_would_mislead_the_reader_is_refused(content, says):
    """Sizes, counts and methods that cannot be are named with the byte or the object."""
    with pytest.raises(LapError, match=says):
        parse(content, "a.blf")


def test_a_bomb_is_not_unpacked():
    """A container that says it is small is not unpacked beyond what it says."""
    bomb = zlib.compress(bytes(50_000_000))
    inner = struct.pack("<H6xL4x", 2, 1000) + bomb
    whole = struct.pack("<4sHHLL", b"LOBJ", 16, 1, 16 + len(inner), 10) + inner
    with pytest.raises(LapError, match="a container of 1001 bytes, not 1000"):
        parse(blf(whole), "a.blf")


def test_writers_of_both_kinds_agree(tmp_path):
    """The helper of these tests writes what python-can writes."""
    log = write(tmp_path / "a.blf", strokes())
    assert len(parse(log.read_bytes(), "a.blf")) == FRAMES
