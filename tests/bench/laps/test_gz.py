"""Logs and laps with .gz on top."""

import gzip

import pytest

from bench.errors import LapError
from bench.laps import gz
from bench.laps.files import read_lap, write_lap
from tests.bench.laps.can.logs import FRAMES, strokes, write
from tests.conftest import wavy_lap


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_lap_tables_may_be_packed_too(tmp_path, suffix):
    """A packed table is the table."""
    lap = wavy_lap(0.1)
    write_lap(lap, tmp_path / f"lap{suffix}")
    packed = tmp_path / f"lap{suffix}.GZ"
    packed.write_bytes(gzip.compress((tmp_path / f"lap{suffix}").read_bytes()))
    assert read_lap(packed) == lap
    assert read_lap(packed).source == packed.name


def test_messages_name_the_packed_file(tmp_path):
    """A refusal of what is inside names the file that the user gave."""
    path = tmp_path / "lap.csv.gz"
    path.write_bytes(gzip.compress(b"t_s,fork_stroke_mm\n0,1\n1,fast\n"))
    with pytest.raises(LapError, match=r"lap\.csv\.gz: line 3, column fork_stroke_mm: 'fast'") as refusal:
        read_lap(path)
    assert str(refusal.value).startswith(str(path))


def test_members_one_after_the_other_are_one_file(tmp_path):
    """Packed files put together unpack to their contents put together; zeros at the end are padding."""
    text = write(tmp_path / "ride.log", strokes()).read_bytes()
    path = tmp_path / "ride.log.gz"
    path.write_bytes(gzip.compress(text[:500]) + gzip.compress(text[500:]) + bytes(512))
    recording = gz.read(path)
    assert (len(recording.tracks["fork_stroke_mm"].t_ns), recording.damage) == (FRAMES, ())


def test_a_packed_log_cut_short_says_so(tmp_path):
    """What can be unpacked is read, and the damage says that it is not all."""
    text = b"".join(b"(%d.5) can0 100#%08x\n" % (k, k * k * 2654435761 % 2**32) for k in range(1000))
    path = tmp_path / "ride.log.gz"
    packed = gzip.compress(text)
    path.write_bytes(packed[: len(packed) // 2])
    recording = gz.read(path)
    assert 100 < len(recording.tracks["fork_stroke_mm"].t_ns) < 900
    assert recording.damage[0].startswith("cut short: the packed data end after ")


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("a.log.gz", b"(0.0) can0 100#01\n", "damaged after 0 unpacked bytes: incorrect header check"),
        (
            "a.log.gz",
            gzip.compress(b"(0.0) can0 100#01\n")[:-8] + bytes(8),
            "damaged after 0 unpacked bytes: incorrect data check",
        ),
        ("a.log.gz", gzip.compress(b""), "empty file"),
        ("a.log.gz", gzip.compress(b"text")[:8], "cut short: the packed data end after 0"),
        ("a.log.gz.gz", gzip.compress(b"text"), "packed twice"),
        ("a.txt.gz", gzip.compress(b"text"), r"unknown suffix '\.txt'"),
        ("a.gz", gzip.compress(b"text"), "unknown suffix ''"),
    ],
)
def test_what_is_no_packed_log_is_refused(tmp_path, name, content, says):
    """Damage of the packing, and what is packed in it, are named."""
    (tmp_path / name).write_bytes(content)
    with pytest.raises(LapError, match=says):
        read_lap(tmp_path / name)


def test_the_unpacked_size_has_a_bound(tmp_path, monkeypatch):
    """A small file that unpacks to a large one is refused at the bound."""
    monkeypatch.setattr(gz, "MOST_BYTES", 10_000_000)
    path = tmp_path / "a.log.gz"
    path.write_bytes(gzip.compress(bytes(20_000_000)))
    with pytest.raises(LapError, match=r"a\.log\.gz: unpacks to more than 10000000 bytes"):
        read_lap(path)
