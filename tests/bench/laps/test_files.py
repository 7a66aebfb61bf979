"""What is true of every lap format."""

import os
import stat
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from bench.errors import LapError
from bench.laps import CHANNELS, Lap, read_lap, write_lap
from bench.laps.files import FORMATS, check_writable, format_of

MDF = pytest.mark.skipif(find_spec("asammdf") is None, reason="asammdf is not installed")
SUFFIXES = sorted(FORMATS)
WRITTEN = [suffix for suffix in SUFFIXES if hasattr(format_of(Path(f"lap{suffix}")), "write")]
EXACT = [".csv", ".mf4", ".parquet"]
"""Formats that bring back the lap itself, not what a logger with its sensors would have made of it."""


def each(suffixes):
    return pytest.mark.parametrize(
        "suffix", [pytest.param(suffix, marks=[MDF] * (suffix == ".mf4")) for suffix in suffixes]
    )


every_format = each(SUFFIXES)
every_written_format = each(WRITTEN)
every_exact_format = each(EXACT)


def a_lap(samples=50):
    rng = np.random.default_rng(1)
    return Lap(np.arange(samples) * 1_000_000, {name: rng.standard_normal(samples) for name in CHANNELS})


finite = st.floats(allow_nan=False, allow_infinity=False)


@every_exact_format
@given(
    steps=st.lists(st.integers(1, 10**12), min_size=2, max_size=20),
    data=st.data(),
    names=st.sets(st.sampled_from(CHANNELS), min_size=1),
)
def test_round_trip_is_exact(tmp_path_factory, suffix, steps, data, names):
    """Reading what was written gives the same nanoseconds and the same float64 values, bit for bit."""
    lap = Lap(
        np.cumsum(steps), {name: data.draw(arrays(np.float64, len(steps), elements=finite)) for name in names}
    )
    path = tmp_path_factory.mktemp("laps") / f"lap{suffix}"
    write_lap(lap, path)
    assert read_lap(path).digest() == lap.digest()


@every_exact_format
def test_one_millisecond_is_a_million_nanoseconds(tmp_path, suffix):
    """The time base read at 1 kHz is exactly 1,000,000 ns apart over a whole lap."""
    lap = a_lap(400_000)
    write_lap(lap, tmp_path / f"lap{suffix}")
    assert set(np.diff(read_lap(tmp_path / f"lap{suffix}").t_ns)) == {1_000_000}


@every_written_format
def test_source_is_the_file_name(tmp_path, suffix):
    """A lap read from a file bears the file's name as its source."""
    write_lap(a_lap(), tmp_path / f"monday{suffix}")
    assert read_lap(tmp_path / f"monday{suffix}").source == f"monday{suffix}"


@every_exact_format
def test_suffix_case_does_not_matter(tmp_path, suffix):
    """A suffix in capitals is the same format."""
    path = tmp_path / f"LAP{suffix.upper()}"
    write_lap(a_lap(), path)
    assert read_lap(path) == a_lap()


@every_written_format
def test_same_lap_gives_the_same_bytes(tmp_path, suffix):
    """Writing a lap twice gives two identical files."""
    for name in "ab":
        write_lap(a_lap(), tmp_path / f"{name}{suffix}")
    assert (tmp_path / f"a{suffix}").read_bytes() == (tmp_path / f"b{suffix}").read_bytes()


@every_format
def test_missing_file(tmp_path, suffix):
    """A path that does not exist is refused by name."""
    with pytest.raises(LapError, match=f"gone{suffix}: no such file"):
        read_lap(tmp_path / f"gone{suffix}")


@every_format
def test_folder(tmp_path, suffix):
    """A folder is refused for reading."""
    path = tmp_path / f"lap{suffix}"
    path.mkdir()
    with pytest.raises(LapError, match="is a folder"):
        read_lap(path)


@every_written_format
def test_folder_in_the_way(tmp_path, suffix):
    """A folder is refused for writing."""
    path = tmp_path / f"lap{suffix}"
    path.mkdir()
    with pytest.raises(LapError, match="is a folder"):
        write_lap(a_lap(), path)


@each(sorted(set(SUFFIXES) - set(WRITTEN)))
def test_formats_that_are_only_read(tmp_path, suffix):
    """A format without a writer is refused for writing, and nothing is written."""
    with pytest.raises(LapError, match=rf"laps cannot be written as \{suffix}"):
        write_lap(a_lap(), tmp_path / f"lap{suffix}")
    assert list(tmp_path.iterdir()) == []


@every_format
def test_empty_file(tmp_path, suffix):
    """A file of no bytes is refused as empty."""
    (tmp_path / f"lap{suffix}").touch()
    with pytest.raises(LapError, match="empty file"):
        read_lap(tmp_path / f"lap{suffix}")


@every_format
def test_pipes_are_refused(tmp_path, suffix):
    """A named pipe under the suffix is refused, not waited for."""
    os.mkfifo(tmp_path / f"lap{suffix}")
    with pytest.raises(LapError, match="not a regular file"):
        read_lap(tmp_path / f"lap{suffix}")


def test_a_format_that_is_only_read_is_not_written(tmp_path, monkeypatch):
    """Where a format's module cannot write, the suffix is refused for writing."""
    monkeypatch.delattr("bench.laps.csv.write")
    with pytest.raises(LapError, match=r"laps cannot be written as \.csv"):
        write_lap(a_lap(), tmp_path / "lap.csv")


def test_unknown_suffix_names_the_known_ones(tmp_path):
    """A suffix of no format is refused, naming it and the known ones, for reading and writing."""
    (tmp_path / "lap.txt").write_text("t_s\n")
    for act in (lambda: read_lap(tmp_path / "lap.txt"), lambda: write_lap(a_lap(), tmp_path / "new.txt")):
        with pytest.raises(LapError, match=r"unknown suffix '\.txt'; the known ones are \.csv, \.parquet"):
            act()
    assert not (tmp_path / "new.txt").exists()


@every_written_format
def test_missing_folder_is_refused_before_anything_is_written(tmp_path, suffix):
    """Writing into a folder that does not exist names that folder."""
    with pytest.raises(LapError, match=r"no folder .*nowhere"):
        check_writable(tmp_path / "nowhere" / f"lap{suffix}")


@every_written_format
@pytest.mark.parametrize("interruption", [KeyboardInterrupt, OSError(28, "No space left on device")])
def test_interrupted_writing_leaves_nothing(tmp_path, monkeypatch, suffix, interruption):
    """When writing is cut short the old file is untouched and no other file is left."""
    path = tmp_path / f"lap{suffix}"
    path.write_bytes(b"old")

    def half(lap, part):
        part.write_bytes(b"half")
        raise interruption

    monkeypatch.setattr(f"{FORMATS[suffix]}.write", half)
    with pytest.raises((KeyboardInterrupt, LapError)):
        write_lap(a_lap(), path)
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


@every_written_format
def test_a_reader_keeps_the_old_lap(tmp_path, suffix):
    """Who has the old file open reads it to its end: the new lap takes its place, not its bytes."""
    path = tmp_path / f"lap{suffix}"
    write_lap(a_lap(50), path)
    old = path.read_bytes()
    with path.open("rb") as reader:
        write_lap(a_lap(60), path)
        assert reader.read() == old


@every_written_format
def test_full_disk_names_the_file_and_the_reason(tmp_path, monkeypatch, suffix):
    """An error of the file system becomes one LapError with the file and the system's words."""
    path = tmp_path / f"lap{suffix}"

    def full(lap, part):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(f"{FORMATS[suffix]}.write", full)
    with pytest.raises(LapError, match=f"lap{suffix}: cannot be written: No space left on device"):
        write_lap(a_lap(), path)


@every_written_format
def test_written_file_has_ordinary_permissions(tmp_path, suffix):
    """A lap file is as readable to others as any new file."""
    write_lap(a_lap(), tmp_path / f"lap{suffix}")
    (tmp_path / "other").touch()
    modes = {stat.S_IMODE(path.stat().st_mode) for path in tmp_path.iterdir()}
    assert len(modes) == 1


@every_exact_format
def test_time_beyond_float_seconds_is_refused(tmp_path, suffix):
    """A time base that seconds in float64 cannot carry to the nanosecond is refused, not rounded."""
    lap = Lap(np.array([0, 10**18 + 1]), {"speed_kmh": np.zeros(2)})
    with pytest.raises(LapError, match="1000000000000000001 ns does not fit"):
        write_lap(lap, tmp_path / f"lap{suffix}")
    assert list(tmp_path.iterdir()) == []
