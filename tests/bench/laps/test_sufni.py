"""Sufni .SST recordings: made-up ones, and the project's own where they are at hand."""

import math
import struct
from pathlib import Path

import numpy as np
import pytest

from bench.errors import LapError
from bench.laps import Lap, read_lap, write_lap
from bench.laps.channel_map import load_map
from bench.laps.sufni import MAPS

REAL = Path(__file__).resolve().parents[3].parent / "shared" / "data" / "sufni-mtb-sst"
CLASH = MAPS / "clash2022.toml"
FORK = {"arm": 134.9375, "max": 234.15625}
SHOCK = {"arm1": 98.9, "arm2": 202.8, "max": 230.0}


def counts_of(fork_mm, shock_mm):
    """The counts at which the two triangles have lost so much of a side, by the law of cosines."""
    arm, longest = FORK["arm"], FORK["max"]
    # The angle at a foot of two equal arms opens by what the counts say.
    fork = [math.acos((longest - s) / 2 / arm) - math.acos(longest / 2 / arm) for s in fork_mm]
    one, two, longest = SHOCK["arm1"], SHOCK["arm2"], SHOCK["max"]

    def between(side):
        return math.acos((one**2 + two**2 - side**2) / (2 * one * two))

    shock = [between(longest) - between(longest - s) for s in shock_mm]
    return np.rint(np.column_stack((fork, shock)) * (4096 / 2 / math.pi)).astype("<u2")


def sst(counts, rate=1000, version=3, magic=b"SST"):
    return (
        struct.pack("<3sBHHq", magic, version, rate, 0, 1_683_457_678) + np.asarray(counts, "<u2").tobytes()
    )


def a_file(tmp_path, data):
    path = tmp_path / "00001.SST"
    path.write_bytes(data)
    return path


def a_ride(samples=300):
    phase = np.arange(samples) / 30
    return 70 + 60 * np.sin(phase), 30 + 25 * np.cos(phase)


def read(tmp_path, data, repair=False):
    return read_lap(a_file(tmp_path, data), load_map(CLASH), repair)


def test_strokes_come_back_within_a_count(tmp_path):
    """Known strokes, put through the triangles into counts, come back within what a count is worth."""
    fork, shock = a_ride()
    lap = read(tmp_path, sst(counts_of(fork, shock)))
    assert np.abs(lap.channels["fork_stroke_mm"] - fork).max() < 0.25
    assert np.abs(lap.channels["rear_stroke_mm"] - shock).max() < 0.16
    assert lap.damage == ()


def test_counts_become_what_the_published_formulas_give(tmp_path):
    """Three counts of each sensor give the numbers worked out apart from the project's two expressions."""
    lap = read(tmp_path, sst([[0, 0], [200, 150], [491, 384]]))
    np.testing.assert_allclose(lap.channels["fork_stroke_mm"], [0.0, 51.4558, 155.1081], atol=1e-3)
    np.testing.assert_allclose(lap.channels["rear_stroke_mm"], [0.0, 20.9307, 55.9142], atol=1e-3)


@pytest.mark.parametrize(("rate", "step_ns"), [(1000, {1_000_000}), (860, {1_162_790, 1_162_791})])
def test_the_header_says_the_rate(tmp_path, rate, step_ns):
    """Samples are as far apart as the header's rate says, from zero, without drift."""
    t_ns = read(tmp_path, sst(np.zeros((9, 2)), rate)).t_ns
    assert set(np.diff(t_ns)) == step_ns
    assert t_ns[-1] == round(8e9 / rate)


def test_a_sensor_just_below_zero_is_at_rest(tmp_path):
    """A few counts below zero, which wrap around to 4095, are a stroke of 0."""
    lap = read(tmp_path, sst([[0, 4095], [4090, 0], [1, 1]]))
    assert lap.channels["fork_stroke_mm"][:2].tolist() == [0.0, 0.0]
    assert lap.channels["rear_stroke_mm"][:2].tolist() == [0.0, 0.0]
    assert lap.damage == ()


@pytest.mark.parametrize(
    ("side", "count"), [(0, 686), (0, 1500), (1, 1057), (1, 4000), (0, 4096), (1, 65535)]
)
def test_counts_of_no_triangle_are_dropped(tmp_path, side, count):
    """A count that folds the triangle, or that the sensor cannot give, is dropped and named by its byte."""
    counts = counts_of(*a_ride())
    counts[100, side] = count
    lap = read(tmp_path, sst(counts))
    assert len(lap.t_ns) == 299
    name = ("front", "rear")[side]
    assert lap.damage[0] == (
        f"{name}: 1 of 300 samples are no angle of its triangle, the first {count} at byte "
        f"{16 + 400 + 2 * side}; dropped"
    )
    assert lap.damage[1].startswith("gap of 2 ms")


def test_dropped_samples_are_filled_in_repair(tmp_path):
    """Repaired, a dropped sample is bridged like any short gap."""
    counts = counts_of(*a_ride())
    counts[100, 0] = 4000
    assert len(read(tmp_path, sst(counts), repair=True).t_ns) == 300


def test_the_wrong_geometry_is_refused(tmp_path):
    """Counts of which more than one in a hundred fit no triangle are refused, asking for the geometry."""
    counts = counts_of(*a_ride())
    counts[::50, 1] = 3000
    with pytest.raises(
        LapError, match=r"rear: 6 of 300 samples .* is it the geometry of .*clash2022\.toml\?"
    ):
        read(tmp_path, sst(counts))


def test_half_a_sample_at_the_end_is_reported(tmp_path):
    """A file that ends within a sample says which bytes are left over."""
    lap = read(tmp_path, sst(np.zeros((5, 2))) + b"\x01\x00\x02")
    assert len(lap.t_ns) == 5
    assert lap.damage == ("bytes 36 to 38: cut within a sample",)


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"SST\x03", "4 bytes, less than the header's 16"),
        (sst([[0, 0]] * 3, magic=b"SSU"), "byte 0: begins with b'SSU', not with b'SST'"),
        (sst([[0, 0]] * 3, version=4), "byte 3: version 4; version 3 is known"),
        (sst([[0, 0]] * 3, rate=0), "byte 4: 0 samples a second"),
        (sst([[0, 0]]), "1 samples: a lap needs at least 2"),
        (sst(np.zeros((0, 2))), "0 samples: a lap needs at least 2"),
        (sst(np.zeros((0, 2))) + b"\x00\x00\x00", "0 samples: a lap needs at least 2"),
    ],
)
def test_refuses_what_is_no_recording(tmp_path, data, says):
    """Another header, no samples: one line with the file and the byte."""
    with pytest.raises(LapError, match=says) as refusal:
        read(tmp_path, data)
    assert "00001.SST: " in str(refusal.value)


def test_without_a_map_the_refusal_names_one(tmp_path):
    """Counts alone are no strokes: the refusal says what is needed and where an example is."""
    with pytest.raises(
        LapError, match=r"holds angles, not strokes; needed is a channel map with \[sst\]"
    ) as no:
        read_lap(a_file(tmp_path, sst(counts_of(*a_ride()))))
    assert str(CLASH) in str(no.value)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("[sst]", "[sst]\nrare = 1"), "unknown key sst.rare; the known ones are front, rear"),
        (("front = {", "# {"), "sst.front is None; it needs arm, max in millimetres"),
        (("[sst]", "[other]"), "unknown key other"),
        (("arm = 134.9375, ", ""), "sst.front is {'max': 234.15625}; it needs arm, max"),
        (("134.9375", "true"), "arm is True, not a length"),
        (("134.9375", '"x"'), "arm is 'x', not a length"),
        (("134.9375", "inf"), "arm is inf, not a length"),
        (("134.9375", "100"), "no triangle has the sides arm 100, max 234.156"),
        (("230.0", "302"), "no triangle has the sides arm1 98.9, arm2 202.8, max 302"),
        (('"front"', '"fork"'), "signal 'fork'; a .sst file has front, rear"),
        (("fork_stroke_mm", "speed_kmh"), "unit 'mm'; speed_kmh can come from"),
    ],
)
def test_a_map_that_does_not_fit_is_refused(tmp_path, change, says):
    """A map without the geometry, or with one that is none, is refused naming table and value."""
    path = tmp_path / "map.toml"
    path.write_text(CLASH.read_text().replace(*change))
    file = a_file(tmp_path, sst(counts_of(*a_ride())))
    with pytest.raises(LapError, match=says):
        read_lap(file, load_map(path))


def test_a_map_needs_only_what_it_maps(tmp_path):
    """A map of the rear alone needs the rear's geometry alone."""
    path = tmp_path / "map.toml"
    path.write_text(
        '[channels.rear_stroke_mm]\nsignal = "rear"\nscale = 2.0\n'
        "[sst]\nrear = { arm1 = 98.9, arm2 = 202.8, max = 230.0 }\n"
    )
    lap = read_lap(a_file(tmp_path, sst([[9, 384], [9999, 384]])), load_map(path))
    np.testing.assert_allclose(lap.channels["rear_stroke_mm"], 2 * 55.9142, atol=1e-3)


def test_it_is_not_written(tmp_path):
    """A lap cannot become a .sst file: it knows no geometry."""
    with pytest.raises(LapError, match=r"laps cannot be written as \.sst"):
        write_lap(Lap(np.arange(3), {"fork_stroke_mm": np.zeros(3)}), tmp_path / "lap.sst")


@pytest.mark.parametrize("seed", range(48))
def test_no_damage_beyond_a_value_passes_in_silence(tmp_path, seed):
    """Cut, flipped, or with bytes lost, a recording is refused or reported, or a value is another.

    Unless the cut falls between samples, the flip makes another count the triangle can have, or the header's
    rate another rate: the format has neither a length nor a checksum that would tell.
    """
    rng = np.random.default_rng(seed)
    whole = read(tmp_path, sst(counts_of(*a_ride())))
    data = bytearray(sst(counts_of(*a_ride())))
    flips = lost = 0
    if seed % 3 == 0:
        lost = int(rng.integers(1, len(data)))
        del data[-lost:]
    elif seed % 3 == 1:
        flips = 1 + seed % 4
        for at in rng.integers(0, len(data), flips):
            data[at] ^= 1 << rng.integers(8)
    else:
        at, lost = int(rng.integers(len(data))), int(rng.integers(1, 99))
        lost = len(data[at : at + lost])
        del data[at : at + lost]
    try:
        lap = read(tmp_path, bytes(data))
    except LapError:
        return
    if lost % 4:
        assert lap.damage
    elif flips and not lap.damage and data[4:6] == b"\xe8\x03":
        changed = [lap.channels[name] != whole.channels[name] for name in whole.channels]
        assert np.count_nonzero(changed) <= flips


@pytest.mark.skipif(not REAL.is_dir(), reason=f"the recordings are not at {REAL}")
def test_the_projects_recordings_are_strokes_of_that_bicycle():
    """Every published recording lies within the fork's 180 mm and the shock's 65 mm, moves, and is sound."""
    paths = sorted(REAL.glob("*.SST"))
    assert len(paths) == 7
    for path in paths:
        lap = read_lap(path, load_map(CLASH))
        assert lap.damage == ()
        assert lap.duration_ns == (path.stat().st_size - 20) // 4 * 1_000_000
        for name, most in (("fork_stroke_mm", 180.0), ("rear_stroke_mm", 65.0)):
            assert lap.channels[name].min() >= 0.0
            assert most / 3 < lap.channels[name].max() < most
