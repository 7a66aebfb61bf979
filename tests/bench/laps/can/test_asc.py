"""Vector's .asc: what other programs write, which python-can does not."""

import pytest

from bench.errors import LapError
from bench.laps.can.asc import read

HEAD = "date Thu Jan 1 12:00:00.000 am 2026\nbase hex  timestamps absolute\n"
BEGIN = "Begin Triggerblock Thu Jan 1 12:00:00.000 am 2026\n"
END = "End TriggerBlock\n"


def frame(ms, data="01 02 03 04", identifier="100"):
    return (
        f"   {ms / 1000:.6f} 1  {identifier}             Rx   d 4 {data}  Length = 0 BitCount = 64 ID = 256\n"
    )


def asc(tmp_path, text):
    path = tmp_path / "ride.asc"
    path.write_text(text, encoding="cp1252")
    return path


def times(recording):
    return (recording.tracks["fork_stroke_mm"].t_ns // 1_000_000).tolist()


@pytest.mark.parametrize(
    "head",
    [
        HEAD + "internal events logged\n// version 9.0.0\n" + BEGIN,
        HEAD + "no internal events logged\n" + BEGIN + "   0.000000 Start of measurement\n",
        HEAD + BEGIN,
        HEAD,
        HEAD.replace("Thu Jan", "Do März"),
        "",
    ],
    ids=["CANoe", "python-can", "without events", "without block", "German", "bare"],
)
def test_no_head_costs_a_frame(tmp_path, head):
    """Whatever stands before the first frame, the first frame is read."""
    text = head + frame(10) + frame(20) + (END if "Begin" in head else "")
    recording = read(asc(tmp_path, text))
    assert (times(recording), recording.damage) == ([10, 20], ())


def test_what_is_no_frame_is_no_damage(tmp_path):
    """Statistics, chip status, triggers, system variables, J1939 and comments are passed over."""
    others = (
        "   0.011000 1  Statistic: D 0 R 0 XD 0 XR 0 E 0 O 0 B 0.00%\n"
        "   0.012000 CAN 1 Status:chip status error active\n"
        "   0.013000 1  J1939TP FEE3p 6  0   0  - Rx d 23 A0 0F A6\n"
        "   0.014000 SV: 3 0 1 ::Engine::Speed = 3\n"
        "   0.015000 Log Trigger Event\n"
        "   0.016000 L1 3c Rx 8 00 00 00 00 00 00 00 00\n"
        "// a comment\n\n"
    )
    recording = read(asc(tmp_path, HEAD + BEGIN + frame(10) + others + frame(20) + END))
    assert (times(recording), recording.damage) == ([10, 20], ())


def test_decimal_numbers(tmp_path):
    """A file in base dec has its identifiers and data in decimal."""
    text = HEAD.replace("hex", "dec") + BEGIN + frame(10, "10 0 0 0", "256") + END
    assert read(asc(tmp_path, text)).tracks["fork_stroke_mm"].values[0] == pytest.approx(10 * 150 / 4095)


def test_relative_time_stamps_are_refused(tmp_path):
    """Times that count from the event before are not taken for times."""
    with pytest.raises(LapError, match=r"ride\.asc: line 2: relative time stamps"):
        read(asc(tmp_path, HEAD.replace("absolute", "relative") + BEGIN + frame(10) + END))


def test_an_open_block_is_reported(tmp_path):
    """Without End TriggerBlock the log was cut short, at a line's end though it be."""
    recording = read(asc(tmp_path, HEAD + BEGIN + frame(10) + frame(20)))
    assert recording.damage == ("no End TriggerBlock: the log was cut short, or not closed",)


@pytest.mark.parametrize(
    "line",
    [
        frame(15).replace("Rx", "Qx"),
        frame(15).replace("100", "1G0"),
        frame(15).replace(" 1  ", " q  "),
        frame(15, "01 02 zz 04"),
        "   0.015000 1  100 Rx d 4 01 02\n",
        frame(15, identifier="900"),
        "   0.015000 99999999999  100 Rx d 4 01 02 03 04\n",
    ],
)
def test_an_isolated_bad_line_is_damage(tmp_path, line):
    """A frame's line that is none is named and passed over; those about it are read."""
    recording = read(asc(tmp_path, HEAD + BEGIN + frame(10) + line + frame(20) + frame(30) + END))
    assert times(recording) == [10, 20, 30]
    assert len(recording.damage) == 1
    assert recording.damage[0].startswith("line 5: ")


def test_two_bad_lines_among_few_are_refused(tmp_path):
    """More than one bad line in a hundred is no log with a scratch."""
    bad = frame(15, "01 02 zz 04")
    with pytest.raises(LapError, match=r"ride\.asc: line 5: .*; 2 lines like it among 2 frames"):
        read(asc(tmp_path, HEAD + BEGIN + frame(10) + bad + bad + frame(20) + END))


def test_a_line_without_end_is_refused(tmp_path):
    """A megabyte without a line's end is not read as a line."""
    with pytest.raises(LapError, match="line 4 is longer than any"):
        read(asc(tmp_path, HEAD + BEGIN + "0.01" + " " * 1_000_000 + "x\n"))
