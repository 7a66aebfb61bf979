"""Candump logs: our own parser, against python-can's and against what people's loggers leave behind."""

import time

import can
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.errors import LapError
from bench.laps.can.candump import parse
from bench.laps.can.frames import ERROR, FD, REMOTE
from tests.conftest import SHARED

KTM = sorted((SHARED / "data" / "ktm-1390-candump").glob("*.log"))
GOOD = b"(1.000000) can0 100#01020304\n"


def one(line):
    frames = parse(line.encode() + b"\n", "a.log")
    assert len(frames) == 1
    assert frames.damage == ()
    return frames


@pytest.mark.parametrize(
    ("line", "identifier", "extended", "flags", "data", "bus", "t_ns"),
    [
        (
            "(1713559096.395291) can0 12F#F82000200000003D",
            0x12F,
            False,
            0,
            "f82000200000003d",
            0,
            1713559096395291000,
        ),
        ("(0.1) vcan12 7FF#", 0x7FF, False, 0, "", 12, 100_000_000),
        ("(0.123456789) can0 1ABCDEF0#01", 0x1ABCDEF0, True, 0, "01", 0, 123_456_789),
        ("(5) slcan 00000100#aAbB", 0x100, True, 0, "aabb", -1, 5_000_000_000),
        ("(0.0) can1 123#R", 0x123, False, REMOTE, "", 1, 0),
        ("(0.0) can1 123##3112233", 0x123, False, FD, "112233", 1, 0),
        ("(0.0) can1 20000088#0000000000000000", 0x88, True, ERROR, "00" * 8, 1, 0),
        ("(0.0) can0 100#01 R", 0x100, False, 0, "01", 0, 0),
        ("(0.0)  can0  100#01\tT \r", 0x100, False, 0, "01", 0, 0),
        (" (0.0) my-bike.can99999999999 100#01", 0x100, False, 0, "01", -1, 0),
    ],
)
def test_reads_a_line(line, identifier, extended, flags, data, bus, t_ns):
    """Every kind of line gives its identifier, flags, data, bus and exact time."""
    frames = one(line)
    payload = bytes.fromhex(data)
    assert (frames.id[0], frames.extended[0], frames.flags[0]) == (identifier, extended, flags)
    assert (frames.length[0], frames.bus[0], frames.t_ns[0]) == (len(payload), bus, t_ns)
    assert frames.payload[0].tobytes() == payload.ljust(8, b"\0")


def test_remote_frames_keep_the_length_they_ask_for():
    """The number after R is the length; there are no data."""
    frames = one("(0.0) can0 123#R8")
    assert (frames.length[0], frames.payload[0].any()) == (8, False)


def test_fd_frames_are_measured_whole():
    """Of a CAN FD frame the first eight bytes and the length are kept."""
    frames = one("(0.0) can0 123##1" + bytes(range(64)).hex())
    assert (frames.length[0], frames.payload[0].tolist()) == (64, list(range(8)))


def test_line_ends_and_empty_lines_do_not_matter():
    """CRLF and blank lines change nothing but the line numbers."""
    plain = parse(GOOD * 3, "a.log")
    other = parse((GOOD + b"\n \t\n" + GOOD * 2).replace(b"\n", b"\r\n"), "a.log")
    assert np.array_equal(plain.payload, other.payload)
    assert (plain.at.tolist(), other.at.tolist()) == ([1, 2, 3], [1, 4, 5])
    assert other.damage == ()


@given(st.data())
def test_reads_as_python_can(tmp_path_factory, data):
    """Whatever python-can writes is read as python-can reads it, bit for bit, times to the microsecond."""
    path = tmp_path_factory.mktemp("log") / "a.log"
    messages = []
    for k in range(data.draw(st.integers(1, 20))):
        extended, remote, fd = (data.draw(st.booleans()) for _ in range(3))
        messages.append(
            can.Message(
                timestamp=k * 1e-3,
                arbitration_id=data.draw(st.integers(0, 0x1FFFFFFF if extended else 0x7FF)),
                is_extended_id=extended,
                is_remote_frame=remote and not fd,
                is_fd=fd,
                is_rx=data.draw(st.booleans()),
                dlc=0 if remote and not fd else None,
                data=None if remote and not fd else data.draw(st.binary(max_size=64 if fd else 8)),
                channel=data.draw(st.sampled_from(["can0", "vcan3", "7"])),
            )
        )
    with can.CanutilsLogWriter(path) as writer:
        for message in messages:
            writer.on_message_received(message)
    frames = parse(path.read_bytes(), "a.log")
    read = list(can.CanutilsLogReader(path))
    assert len(frames) == len(read) == len(messages)
    assert frames.id.tolist() == [m.arbitration_id for m in read]
    assert frames.extended.tolist() == [m.is_extended_id for m in read]
    assert frames.flags.tolist() == [REMOTE * m.is_remote_frame + FD * m.is_fd for m in read]
    assert frames.length.tolist() == [m.dlc for m in read]
    assert [row.tobytes() for row in frames.payload] == [bytes(m.data[:8]).ljust(8, b"\0") for m in read]
    assert (frames.t_ns // 1000).tolist() == [round(m.timestamp * 1e6) for m in read]


@pytest.mark.parametrize(
    "line",
    [
        "can0 100#01",
        "(1.0) can0 100",
        "(1.0) can0 100 [2] 01 02",
        "(1.0) can0 100#0",
        "(1.0) can0 100#0g",
        "(1.0) can0 100#010203040506070809",
        "(1.0) can0 1000#01",
        "(1.0) can0 800#01",
        "(1.0) can0 C0000000#01",
        "(1.0) can0 123456789#01",
        "(1.0) can0 100##",
        "(1.0) can0 100#01 X",
        "(1.0) can0 100#01R",
        "(1.0)can0 100#01",
        "(1.) can0 100#01",
        "(-1.0) can0 100#01",
        "(1.0123456789) can0 100#01",
        "(9999999999.0) can0 100#01",
        "1.0) can0 100#01",
        "(1.0 can0 100#01",
        "\0\0\0\0",
        "(1.0) can0 100#01\0",
    ],
)
def test_an_isolated_bad_line_is_damage(line):
    """A line that is no frame is named by number and passed over; the lines about it are read."""
    frames = parse(GOOD * 2 + line.encode() + b"\n" + GOOD, "a.log")
    assert frames.at.tolist() == [1, 2, 4]
    assert len(frames.damage) == 1
    assert frames.damage[0].startswith("line 3: no frame of candump -L: ")
    assert "\n" not in frames.damage[0]


def test_damage_beyond_the_first_lines_is_counted():
    """Three bad lines are named, the others counted."""
    text = GOOD * 1000 + (b"x\n" + GOOD) * 5
    assert parse(text, "a.log").damage[-2:] == (
        "line 1005: no frame of candump -L: 'x'",
        "and 2 more lines like these",
    )


def test_the_first_line_must_be_a_frame():
    """A file that does not begin with a frame is no candump log, and the message shows why."""
    with pytest.raises(LapError, match=r"a\.log: line 2: no frame of candump -L: 'date Thu'"):
        parse(b"\ndate Thu\n" + GOOD * 500, "a.log")


def test_too_many_bad_lines_are_refused():
    """More than one bad line in a hundred is no log with a scratch."""
    with pytest.raises(LapError, match=r"a\.log: line 101: .*; 3 lines like it among 200 frames"):
        parse(GOOD * 100 + b"x\ny\nz\n" + GOOD * 100, "a.log")


def test_a_line_cut_short_is_reported():
    """The last line without its end is named as cut short, and no bad line is counted for it."""
    frames = parse(GOOD * 3 + GOOD[:16], "a.log")
    assert len(frames) == 3
    assert frames.damage == ("line 4: cut short, it does not end: '(1.000000) can0 '",)


def test_a_frame_that_may_be_cut_short_is_reported():
    """A last line that is a frame but does not end may have lost data: it is kept, and said."""
    frames = parse(GOOD * 2 + GOOD[:-3], "a.log")
    assert frames.length.tolist() == [4, 4, 3]
    assert frames.damage == ("line 3: possibly cut short, it does not end: '(1.000000) can0 100#010203'",)


@pytest.mark.parametrize("text", [b"(1.0) can0 10", b"\n\n", b"#" * 1000, b"\xff\xfe(\x001\x00"])
def test_a_file_without_a_frame_is_refused(text):
    """Nothing to read is a LapError in one line."""
    with pytest.raises(LapError, match=r"a\.log: ") as refusal:
        parse(text, "a.log")
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("path", KTM or [None], ids=lambda path: path.stem if path else "none")
def test_real_logs_are_read_whole(path):
    """The logs of a KTM give as many frames, with the same data, as python-can finds."""
    if path is None:
        pytest.skip("shared/data/ktm-1390-candump is not there")
    frames = parse(path.read_bytes(), path.name)
    messages = list(can.CanutilsLogReader(path))
    assert len(frames) == len(messages)
    assert frames.damage == ()
    assert frames.id.tolist() == [m.arbitration_id for m in messages]
    assert frames.payload.tobytes() == b"".join(bytes(m.data).ljust(8, b"\0") for m in messages)
    assert (frames.t_ns // 1000).tolist() == [round(m.timestamp * 1e6) for m in messages]


def test_is_many_times_faster_than_python_can(tmp_path):
    """20,000 frames are parsed at least ten times as fast as python-can reads them."""
    path = tmp_path / "a.log"
    path.write_bytes(b"(1713559096.395291) can0 12F#F82000200000003D\n" * 20_000)
    parse(GOOD, "")

    def seconds(read):
        before = time.process_time()
        assert read() == 20_000
        return time.process_time() - before

    ours = min(seconds(lambda: len(parse(path.read_bytes(), ""))) for _ in range(3))
    assert seconds(lambda: sum(1 for _ in can.CanutilsLogReader(path))) > 10 * ours
