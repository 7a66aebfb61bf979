import os
import time
from pathlib import Path

import numpy as np
import pytest

from bench.errors import LapError
from bench.laps import CHANNELS, Lap, read_lap, write_lap

GOOD = "t_s,fork_stroke_mm\n0,50\n0.001,51.5\n0.002,52\n"


def read(tmp_path, text):
    path = tmp_path / "lap.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_lap(path)


def test_reads_what_a_person_writes(tmp_path):
    """Seconds and values come back as nanoseconds and float64."""
    lap = read(tmp_path, GOOD)
    assert lap.t_ns.tolist() == [0, 1_000_000, 2_000_000]
    assert lap.channels["fork_stroke_mm"].tolist() == [50.0, 51.5, 52.0]


@pytest.mark.parametrize(
    "text",
    [
        GOOD.replace("\n", "\r\n"),
        "\ufeff" + GOOD,
        GOOD.replace(",", " , "),
        GOOD.rstrip("\n"),
        GOOD + "\n\n",
        GOOD.replace("0.001", "1e-3"),
        GOOD.replace("t_s,fork_stroke_mm", '"t_s","fork_stroke_mm"'),
    ],
    ids=["crlf", "bom", "spaces", "no last newline", "blank last lines", "exponent", "quoted header"],
)
def test_habits_of_other_programs_are_read_the_same(tmp_path, text):
    """Line ends, byte order marks, spaces and the like do not change the lap."""
    assert read(tmp_path, text) == read(tmp_path, GOOD)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("t_s,fork_stroke_mm\n", "no samples"),
        ("t_s,fork_stroke_mm", "no samples"),
        (GOOD.replace("51.5", "5_1"), "invalid value '5_1'"),
        (GOOD.replace("51.5", "5" * 200_000), "line 3: field larger than"),
        (GOOD.encode() * 1000 + b"0,\xff", "line 5, column t_s: 't_s'"),
        (GOOD.encode() + b"\n" * 20_000 + b"0,\xff", "not UTF-8 text: byte 0xff"),
        ("t_s,fork_stroke_mm\n0,50\n", "1 samples: a lap needs at least 2"),
        ("time,fork_stroke_mm\n0,50\n", "unknown column 'time'; the known ones are t_s, fork_stroke_mm"),
        ("fork_stroke_mm,speed_kmh\n0,50\n", "no column t_s; it has fork_stroke_mm, speed_kmh"),
        ("t_s,roll_dps\n0,50\n", "unknown column 'roll_dps'; the known ones are t_s, fork_stroke_mm"),
        ("t_s\n0\n1\n", "no channel beside t_s"),
        ("t_s,speed_kmh,speed_kmh\n0,1,2\n", "column speed_kmh appears twice"),
        (GOOD.replace("51.5", "fast"), "line 3, column fork_stroke_mm: 'fast' is not a finite number"),
        (GOOD.replace("51.5", ""), "line 3, column fork_stroke_mm: '' is not a finite number"),
        (GOOD.replace("51.5", "nan"), "line 3, column fork_stroke_mm: 'nan' is not a finite number"),
        (GOOD.replace("51.5", "-inf"), "line 3, column fork_stroke_mm: '-inf' is not a finite number"),
        (GOOD.replace("0.002", "later"), "line 4, column t_s: 'later' is not a finite number"),
        (GOOD.replace("0.002", "0.001"), "does not increase at sample 2: 0.001 s then 0.001 s"),
        (GOOD.replace("0.002", "0.0005"), "does not increase at sample 2: 0.001 s then 0.0005 s"),
        (GOOD.replace("\n0,", "\n-0.5,"), "negative time: it starts at -0.5 s"),
        (GOOD.replace("0.002", "1e300"), "row 3, column t_s: 1e\\+300 s is beyond any lap"),
        (GOOD.replace("51.5", "51.5,7"), "line 3 has 3 cells, the header 2"),
        (GOOD.replace(",51.5", ""), "line 3 has 1 cells, the header 2"),
        (GOOD.replace(",", ";"), "unknown column 't_s;fork_stroke_mm'"),
        (GOOD.encode().replace(b"51.5", b"5\xff"), "not UTF-8 text: byte 0xff"),
        (GOOD.encode("utf-16"), "not UTF-8 text: byte 0xff"),
        (b"\x00" * 100, "unknown column"),
        (b"\n\n\n", "no column t_s"),
    ],
)
def test_refuses_what_is_no_lap(tmp_path, text, says):
    """Bad input is one line with the file, where in it, and the value."""
    with pytest.raises(LapError, match=says) as refusal:
        read(tmp_path, text)
    assert "lap.csv: " in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_line_numbers_count_blank_lines(tmp_path):
    """The line named is the one an editor shows, blank lines counted."""
    with pytest.raises(LapError, match="line 5, column fork_stroke_mm: 'x'"):
        read(tmp_path, "t_s,fork_stroke_mm\n0,50\n\n\n0.001,x\n")


def test_bad_cell_at_the_end_of_a_long_file_is_found(tmp_path):
    """A bad cell is named however far down it is."""
    rows = "".join(f"{k / 1000},50\n" for k in range(100_000))
    with pytest.raises(LapError, match="line 100002, column fork_stroke_mm: 'x'"):
        read(tmp_path, f"t_s,fork_stroke_mm\n{rows}200,x\n")


def test_reads_a_long_lap_in_a_few_seconds(tmp_path):
    """400,000 samples of all channels are read within 3 s of CPU time."""
    rng = np.random.default_rng(0)
    lap = Lap(np.arange(400_000) * 1_000_000, {name: rng.standard_normal(400_000) for name in CHANNELS})
    write_lap(lap, tmp_path / "lap.csv")
    before = time.process_time()
    read_lap(tmp_path / "lap.csv")
    assert time.process_time() - before < 3.0


def test_name_that_is_no_text(tmp_path):
    """A file is read whatever bytes its name is made of."""
    path = Path(os.fsdecode(os.fsencode(tmp_path) + b"/\xff.csv"))
    path.write_text(GOOD)
    assert read_lap(path).t_ns.tolist() == [0, 1_000_000, 2_000_000]
