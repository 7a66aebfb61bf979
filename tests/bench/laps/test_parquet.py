import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from bench.errors import LapError
from bench.laps import Lap, read_lap, write_lap

T_S = [0.0, 0.001, 0.002]


def read(tmp_path, table):
    path = tmp_path / "lap.parquet"
    pq.write_table(table, path)
    return read_lap(path)


def test_other_numeric_types_are_read(tmp_path):
    """Columns of float32 and integers, as other programs write them, are read as float64."""
    table = pa.table(
        {
            "t_s": T_S,
            "speed_kmh": pa.array([1, 2, 3], pa.int16()),
            "fork_stroke_mm": np.float32([1.5, 2.5, 3]),
        }
    )
    lap = read(tmp_path, table)
    assert lap.channels["speed_kmh"].tolist() == [1.0, 2.0, 3.0]
    assert lap.channels["fork_stroke_mm"].dtype == np.float64


@pytest.mark.parametrize(
    ("columns", "says"),
    [
        ({"t_s": T_S, "speed_kmh": ["a", "b", "c"]}, "column speed_kmh holds string, not numbers"),
        ({"t_s": T_S, "speed_kmh": [True, False, True]}, "column speed_kmh holds bool, not numbers"),
        ({"t_s": T_S, "speed_kmh": [[1.0], [2.0], [3.0]]}, "column speed_kmh holds list"),
        ({"t_s": T_S, "speed_kmh": [1.0, None, 3.0]}, "row 2, column speed_kmh: empty"),
        (
            {"t_s": T_S, "speed_kmh": [1.0, 2.0, np.nan]},
            "row 3, column speed_kmh: nan is not a finite number",
        ),
        ({"t_s": T_S, "roll_dps": T_S}, "unknown column 'roll_dps'"),
        ({"speed_kmh": T_S}, "no column t_s; it has speed_kmh"),
        ({"t_s": T_S}, "no channel beside t_s"),
        ({"t_s": T_S[::-1], "speed_kmh": T_S}, "does not increase at sample 1: 0.002 s then 0.001 s"),
        ({"t_s": [-1.0, 0.0, 1.0], "speed_kmh": T_S}, "negative time: it starts at -1 s"),
        ({"t_s": np.zeros(0), "speed_kmh": np.zeros(0)}, "no samples"),
    ],
)
def test_refuses_what_is_no_lap(tmp_path, columns, says):
    """Bad input is one line with the file, where in it, and the value."""
    with pytest.raises(LapError, match=says) as refusal:
        read(tmp_path, pa.table(columns))
    assert "lap.parquet: " in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_refuses_a_column_that_appears_twice(tmp_path):
    """Two columns of one name are refused by name."""
    twice = pa.table([pa.array(T_S)] * 3, names=["t_s", "speed_kmh", "speed_kmh"])
    with pytest.raises(LapError, match="column speed_kmh appears twice"):
        read(tmp_path, twice)


def test_refuses_what_is_not_parquet(tmp_path):
    """Another file under the suffix is refused as not Parquet."""
    path = tmp_path / "lap.parquet"
    path.write_text("t_s,speed_kmh\n0,1\n" * 10)
    with pytest.raises(LapError, match=r"lap\.parquet: not a Parquet file"):
        read_lap(path)


@pytest.mark.parametrize("keep", [3, 0.5, 0.99])
def test_refuses_a_truncated_file(tmp_path, keep):
    """A file cut short anywhere is refused with one line."""
    path = tmp_path / "lap.parquet"
    write_lap(Lap(np.arange(1000), {"speed_kmh": np.arange(1000.0)}), path)
    whole = path.read_bytes()
    path.write_bytes(whole[: keep if keep > 1 else int(keep * len(whole))])
    with pytest.raises(LapError, match="not a Parquet file, or cut short") as refusal:
        read_lap(path)
    assert "\n" not in str(refusal.value)


def test_damaged_bytes_never_escape_as_another_error(tmp_path):
    """A file with damaged bytes is read or refused with a LapError, nothing else."""
    path = tmp_path / "lap.parquet"
    write_lap(Lap(np.arange(200), {"speed_kmh": np.arange(200.0)}), path)
    whole = path.read_bytes()
    rng = np.random.default_rng(7)
    refused = 0
    for _ in range(200):
        damaged = bytearray(whole)
        for at in rng.integers(0, len(whole), 3):
            damaged[at] ^= int(rng.integers(1, 256))
        path.write_bytes(damaged)
        try:
            read_lap(path)
        except LapError:
            refused += 1
    assert refused > 100
