"""The blocks of MDF4 files: what damaged ones must not do to asammdf, or to whoever reads the lap."""

import random
import struct
import zlib

import pytest

from bench.errors import LapError
from bench.laps.mdf.mf4 import read
from tests.bench.laps.mdf.files import block, mf4, patched, signal, unsorted

pytest.importorskip("asammdf")


def test_records_that_take_turns_are_told_apart(tmp_path):
    """An unsorted file, as a logger leaves it, gives each group its own records."""
    recording = read(unsorted(tmp_path / "ride.mf4"))
    assert recording.tracks["fork_stroke_mm"].values.tolist() == list(range(10))
    assert recording.tracks["rear_stroke_mm"].t_ns.tolist() == [k * 10_000_000 for k in (1, 3, 5, 7, 9)]
    assert recording.damage == ()


def test_a_bomb_is_not_unpacked(tmp_path):
    """Packed data that say they are small are not unpacked beyond what they say."""
    path = mf4(tmp_path, [signal("fork_stroke_mm")])
    content = bytearray(path.read_bytes())
    bomb = zlib.compress(bytes(50_000_000))
    body = struct.pack("<2sBxIQQ", b"DT", 0, 0, 320, len(bomb)) + bomb
    at = len(content) + -len(content) % 8
    content = content.ljust(at, b"\0") + struct.pack("<4s4xQQ", b"##DZ", 24 + len(body), 0) + body
    struct.pack_into("<Q", content, block(path, b"DG") + 40, at)
    path.write_bytes(content)
    with pytest.raises(LapError, match=f"MDF block at byte {at}: 321 bytes unpacked, not 320"):
        read(path)


@pytest.mark.parametrize(
    ("name", "offset", "layout", "value", "says"),
    [
        (b"CG", 24 + 48 + 8, "<Q", 2**60, "records: more than"),
        (b"CG", 24 + 48 + 8, "<Q", 21, "bytes of data for records of .*: cut short"),
        (b"CN", 24 + 64 + 4, "<I", 1000, "a channel beyond its record"),
        (b"CN", 24 + 64 + 2, "<B", 99, "data type 99"),
        (b"DG", 24, "<Q", 2**40, "a link beyond the .* bytes of the file"),
        (b"CN", 24, "<Q", 65, "a link beyond"),
        (b"CG", 8, "<Q", 2**40, "beyond the .* of the file: cut short"),
        (b"CG", 8, "<Q", 96, "CG of 6 links in 96 bytes"),
        (b"DG", 24 + 16, "<Q", 64, "leads back to byte 64"),
    ],
)
def test_blocks_that_do_not_hang_together_are_refused(tmp_path, name, offset, layout, value, says):
    """A count, a place or a link that cannot be is found before asammdf follows it."""
    path = mf4(tmp_path, [signal("fork_stroke_mm")])
    with pytest.raises(LapError, match=says):
        read(patched(path, block(path, name) + offset, layout, value))


def test_fewer_records_than_data_are_reported(tmp_path):
    """A count that is too small leaves data behind, and says so."""
    path = mf4(tmp_path, [signal("fork_stroke_mm")])
    recording = read(patched(path, block(path, b"CG") + 24 + 48 + 8, "<Q", 10))
    assert len(recording.tracks["fork_stroke_mm"].t_ns) == 10
    assert recording.damage[0].endswith("160 bytes beyond its records passed over")


def test_a_chain_in_a_circle_is_refused(tmp_path):
    """A channel that is its own successor would be read for ever."""
    path = mf4(tmp_path, [signal("fork_stroke_mm")])
    at = block(path, b"CN")
    with pytest.raises(LapError, match=f"MDF block at byte {at}: leads back to byte {at}"):
        read(patched(path, at + 24, "<Q", at))


@pytest.mark.parametrize(
    ("at", "value", "says"),
    [
        (0, b"UnFinMF ", "not finalised: the logger was stopped while writing"),
        (60, b"\x01", "not finalised"),
        (28, b"\x4a\x01", "MDF version 3.30"),
        (0, b"PK", "not an MDF file"),
        (64, b"##HX", "no header"),
    ],
)
def test_other_files_are_refused(tmp_path, at, value, says):
    """Unfinished files, older versions and other formats are named for what they are."""
    path = mf4(tmp_path, [signal("fork_stroke_mm")])
    with pytest.raises(LapError, match=says):
        read(patched(path, at, f"{len(value)}s", value))


@pytest.mark.parametrize("compression", [0, 2], ids=["stored", "packed"])
def test_damage_is_refused_or_reported(tmp_path, compression):
    """Cut short a file is refused; with a bit flipped it has all its samples, or says so, or is refused.

    A bit of a stored sample or of a conversion's factor makes another valid file: MDF has no checksum.
    """
    both = [signal("fork_stroke_mm"), signal("speed_kmh", unit="km/h")]
    path = mf4(tmp_path, both, compression=compression)
    content = path.read_bytes()
    rng = random.Random(3)
    for _ in range(40):
        path.write_bytes(content[: rng.randrange(1, len(content))])
        with pytest.raises(LapError):
            read(path)
        damaged = bytearray(content)
        damaged[rng.randrange(len(content))] ^= 1 << rng.randrange(8)
        path.write_bytes(damaged)
        try:
            recording = read(path)
        except LapError:
            continue
        assert recording.damage or [len(track.t_ns) for track in recording.tracks.values()] == [20, 20]
