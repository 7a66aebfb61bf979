"""PEAK's .trc: its versions, and what python-can does not say of them."""

import pytest

from bench.errors import LapError
from bench.laps.can.trc import read

V1_0 = "     1)   {ms} 0100  4  01 02 03 04 \n"
V1_1 = "     1)   {ms}.0  Rx         0100  4    01 02 03 04 \n"
V1_3 = "     1)   {ms}.0 1  Rx        0100 -  4    01 02 03 04 \n"
V2_1 = "      1     {ms}.000 DT 1      0100 Rx -  4    01 02 03 04 \n"
HEADS = {
    V1_0: ";   C:\\ride.trc\n",
    V1_1: ";$FILEVERSION=1.1\n;$STARTTIME=45000.5\n;\n",
    V1_3: ";$FILEVERSION=1.3\n;$STARTTIME=45000.5\n;\n",
    V2_1: ";$FILEVERSION=2.1\n;$STARTTIME=45000.5\n;$COLUMNS=N,O,T,B,I,d,R,L,D\n;\n",
}


def trc(tmp_path, text):
    path = tmp_path / "ride.trc"
    path.write_text(text)
    return path


def times(recording):
    return (recording.tracks["fork_stroke_mm"].t_ns // 1_000_000).tolist()


@pytest.mark.parametrize("line", HEADS, ids=["1.0", "1.1", "1.3", "2.1"])
def test_every_version_gives_its_frames(tmp_path, line):
    """Frames are read with their times from the log's start, whatever its date."""
    recording = read(trc(tmp_path, HEADS[line] + "".join(line.format(ms=ms) for ms in (10, 20, 30))))
    assert (times(recording), recording.damage) == ([10, 20, 30], ())


@pytest.mark.parametrize("version", ["1.2", "3.0", ""])
def test_other_versions_are_refused(tmp_path, version):
    """A version that python-can would take for 1.0 is refused by number."""
    text = HEADS[V2_1].replace("2.1", version) + V2_1.format(ms=10)
    with pytest.raises(LapError, match=f"version '{version}'; the known ones are 1.0, 1.1"):
        read(trc(tmp_path, text))


def test_bus_status_is_no_damage(tmp_path):
    """Lines of status, errors and events are passed over."""
    others = "      2       11.000 ST 1                Rx -  4    00 00 00 08 \n; a comment\n\n"
    recording = read(trc(tmp_path, HEADS[V2_1] + V2_1.format(ms=10) + others + V2_1.format(ms=20)))
    assert (times(recording), recording.damage) == ([10, 20], ())


@pytest.mark.parametrize(
    "change", [("DT", "DX"), ("0100", "01x0"), (" 4 ", " 9 "), (" Rx -  4    01 02 03 04 ", "")]
)
def test_an_isolated_bad_line_is_damage(tmp_path, change):
    """A frame's line that is none is named and passed over; those about it are read."""
    lines = [V2_1.format(ms=ms) for ms in (10, 20, 30)]
    recording = read(trc(tmp_path, HEADS[V2_1] + lines[0] + lines[1].replace(*change) + lines[2]))
    assert times(recording) == [10, 30]
    assert len(recording.damage) == 1
    assert recording.damage[0].startswith("line 6: ")


def test_columns_must_be_different(tmp_path):
    """A column that stands there twice would be read in the place of another."""
    with pytest.raises(LapError, match=r"line 3: a column appears twice: O,O,T"):
        read(trc(tmp_path, HEADS[V2_1].replace("N,O", "O,O") + V2_1.format(ms=10)))


def test_columns_that_are_missing_are_refused(tmp_path):
    """A head without columns is a LapError, not python-can's."""
    text = HEADS[V2_1].replace(";$COLUMNS=N,O,T,B,I,d,R,L,D\n", "") + V2_1.format(ms=10)
    with pytest.raises(LapError, match=r"ride\.trc: line 4: File has no column information"):
        read(trc(tmp_path, text))


def test_a_last_line_without_its_end_is_whole_if_its_bytes_are(tmp_path):
    """PEAK's programs end the last line with the file; only half a byte there is suspicious."""
    text = HEADS[V2_1] + V2_1.format(ms=10) + V2_1.format(ms=20).rstrip()
    recording = read(trc(tmp_path, text))
    assert (times(recording), recording.damage) == ([10, 20], ())
    recording = read(trc(tmp_path, text.removesuffix("4")))
    assert len(recording.damage) == 1
