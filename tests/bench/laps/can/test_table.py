"""python-can's .csv, beside the lap tables of the same suffix."""

import pytest

from bench.errors import LapError
from bench.laps.files import format_of, read_lap
from tests.bench.laps.can.logs import FRAMES, strokes, write

HEADER = "timestamp,arbitration_id,extended,remote,error,dlc,data\n"


def csv(tmp_path, *lines):
    path = tmp_path / "ride.csv"
    path.write_text(HEADER + "".join(f"{line}\n" for line in lines))
    return path


def read(path):
    return format_of(path).read(path)


def test_the_header_decides(tmp_path):
    """A .csv with python-can's header is a CAN log, any other a lap table."""
    assert len(read(write(tmp_path / "log.csv", strokes())).tracks["fork_stroke_mm"].t_ns) == FRAMES
    (tmp_path / "lap.csv").write_text("t_s,fork_stroke_mm\n0,1\n1,2\n")
    assert read_lap(tmp_path / "lap.csv").channels["fork_stroke_mm"].tolist() == [1.0, 2.0]


def test_habits_of_other_programs(tmp_path):
    """CRLF, a byte order mark and blank lines change nothing."""
    path = write(tmp_path / "log.csv", strokes())
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes().replace(b"\n", b"\r\n") + b"\r\n")
    recording = read(path)
    assert (len(recording.tracks["fork_stroke_mm"].t_ns), recording.damage) == (FRAMES, ())


@pytest.mark.parametrize(
    "line",
    [
        "0.2,0x100,0,0,0,4",
        "0.2,0x100,0,0,0,4,AQID",
        "later,0x100,0,0,0,4,AQIDBA==",
        "nan,0x100,0,0,0,4,AQIDBA==",
        "x",
    ],
)
def test_an_isolated_bad_line_is_damage(tmp_path, line):
    """A line that is no frame is named and passed over; those about it are read."""
    good = [f"0.{k},0x100,0,0,0,4,AQIDBA==" for k in (1, 3, 4)]
    recording = read(csv(tmp_path, good[0], line, *good[1:]))
    assert recording.tracks["fork_stroke_mm"].t_ns.tolist() == [100_000_000, 300_000_000, 400_000_000]
    assert len(recording.damage) == 1
    assert recording.damage[0].startswith("line 3: ")


def test_a_log_without_frames_is_refused(tmp_path):
    """A header alone is no ride."""
    with pytest.raises(LapError, match=r"ride\.csv: no CAN frame"):
        read(csv(tmp_path))
