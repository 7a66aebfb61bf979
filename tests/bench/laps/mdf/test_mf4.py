"""ASAM MDF4: measured channels by name or map, and bus logs."""

import numpy as np
import pytest

from bench.errors import LapError
from bench.laps import CHANNELS, Lap, write_lap
from bench.laps.channel_map import load_map
from bench.laps.mdf.mf4 import read
from bench.recorder import record
from targets.ecu import Frame
from tests.bench.laps.mdf.files import block, mf4, patched, signal

asammdf = pytest.importorskip("asammdf")


def mapped(tmp_path, text):
    (tmp_path / "map.toml").write_text(text)
    return load_map(tmp_path / "map.toml")


def test_groups_of_different_rates_keep_their_own_times(tmp_path):
    """Channels of two groups are two time bases, and the channels of one group share theirs."""
    fast = np.arange(100) / 500
    path = mf4(
        tmp_path,
        [signal("fork_stroke_mm"), signal("speed_kmh", unit="km/h")],
        [signal("rear_stroke_mm", t_s=fast)],
    )
    recording = read(path)
    assert recording.common is False
    assert recording.tracks["fork_stroke_mm"].t_ns is recording.tracks["speed_kmh"].t_ns
    assert recording.tracks["rear_stroke_mm"].t_ns.tolist() == (np.arange(100) * 2_000_000).tolist()
    assert recording.damage == ()


def test_one_group_is_one_time_base(tmp_path):
    """A file of one group is a table."""
    assert read(mf4(tmp_path, [signal("fork_stroke_mm"), signal("rear_stroke_mm")])).common


def test_raw_counts_are_converted_as_the_file_says(tmp_path):
    """Integers with a linear conversion come in physical values."""
    counts = signal("fork_stroke_mm", np.arange(20, dtype=np.uint16), conversion={"a": 0.5, "b": 1.0})
    assert (
        read(mf4(tmp_path, [counts])).tracks["fork_stroke_mm"].values.tolist()
        == (np.arange(20) * 0.5 + 1).tolist()
    )


def test_a_map_names_channels_and_the_file_their_units(tmp_path):
    """A mapped channel is converted from the map's unit, else the file's, then scaled and shifted."""
    path = mf4(tmp_path, [signal("Gabel", unit="cm"), signal("v", unit="m/s"), signal("Rear", unit="?")])
    channel_map = mapped(
        tmp_path,
        'rate_hz = 50\n[channels.fork_stroke_mm]\nsignal = "Gabel"\nscale = 2\noffset = 3\n'
        '[channels.speed_kmh]\nsignal = "v"\n[channels.rear_stroke_mm]\nsignal = "Rear"\nunit = "in"\n',
    )
    recording = read(path, channel_map)
    values = {name: track.values[1] for name, track in recording.tracks.items()}
    assert values == {"fork_stroke_mm": 23.0, "rear_stroke_mm": 25.4, "speed_kmh": 3.6}
    assert recording.rate_hz == 50.0


def test_other_channels_are_passed_over_and_named(tmp_path):
    """Without a map, channels that no lap has are left out, and said."""
    recording = read(mf4(tmp_path, [signal("fork_stroke_mm"), signal("oil", unit="°C")]))
    assert list(recording.tracks) == ["fork_stroke_mm"]
    assert recording.damage == ("channels passed over, for no lap has them: oil",)


def test_invalid_samples_are_left_out_and_counted(tmp_path):
    """Samples that the file marks invalid are no samples."""
    marks = np.arange(20) % 10 == 3
    recording = read(mf4(tmp_path, [signal("fork_stroke_mm", invalidation_bits=marks)]))
    assert recording.tracks["fork_stroke_mm"].values.tolist() == [k for k in range(20) if k % 10 != 3]
    assert recording.damage == ("channel fork_stroke_mm: 2 of 20 samples not valid, left out",)


@pytest.mark.parametrize(
    ("signals", "says"),
    [
        ([signal("fork_stroke_mm", unit="cm")], r"channel fork_stroke_mm is in 'cm'; a channel map says"),
        ([signal("Gabel")], "no channel of fork_stroke_mm, .*; it has Gabel"),
        ([signal("fork_stroke_mm", [np.nan] * 20)], "channel fork_stroke_mm, sample 1: value nan"),
        ([signal("fork_stroke_mm", t_s=np.full(20, np.inf))], "channel fork_stroke_mm, sample 1: time inf"),
        ([signal("fork_stroke_mm", np.array([b"high"] * 20), encoding="utf-8")], "holds .*, not numbers"),
        (
            [signal("fork_stroke_mm", np.arange(20, dtype=np.uint8), conversion={"formula": "X * 2"})],
            "channel fork_stroke_mm: a conversion .* by formula",
        ),
    ],
)
def test_channels_that_are_no_measurement_are_refused(tmp_path, signals, says):
    """Unit, kind, conversion and values that make no channel are named."""
    with pytest.raises(LapError, match=says) as refusal:
        read(mf4(tmp_path, signals))
    assert "\n" not in str(refusal.value)


def test_a_name_in_two_groups_is_refused(tmp_path):
    """Which of two channels of one name is meant, nobody can say."""
    with pytest.raises(LapError, match="channel fork_stroke_mm is there 2 times, in groups 0, 1"):
        read(mf4(tmp_path, [signal("fork_stroke_mm")], [signal("fork_stroke_mm")]))


def test_a_mapped_channel_that_is_missing_is_named(tmp_path):
    """The message says what is there instead."""
    channel_map = mapped(tmp_path, '[channels.fork_stroke_mm]\nsignal = "Fork"\n')
    with pytest.raises(LapError, match="no channel Fork; it has Gabel"):
        read(mf4(tmp_path, [signal("Gabel")]), channel_map)


def test_a_recording_of_ours_is_a_bus_log(tmp_path):
    """What the recorder wrote is read through the DBC, each frame at its time, from bus 1."""
    rows = [(k * 10_000_000, Frame(0x100, bytes([k, 0, 0, 0])), "MDLOG") for k in range(5)]
    record(tmp_path / "run.mf4", rows)
    row = '[channels.fork_stroke_mm]\nsignal = "STROKES.fork_stroke_mm"\nbus = 1\n'
    for channel_map in (None, mapped(tmp_path, row)):
        track = read(tmp_path / "run.mf4", channel_map).tracks["fork_stroke_mm"]
        assert track.t_ns.tolist() == [k * 10_000_000 for k in range(5)]
        assert (track.values * 4095 / 150).tolist() == pytest.approx(range(5))


def test_units_are_written(tmp_path):
    """Other programs find each channel's unit in the file, and its time in seconds."""
    write_lap(Lap(np.arange(20), {name: np.arange(20.0) for name in CHANNELS}), tmp_path / "lap.mf4")
    with asammdf.MDF(tmp_path / "lap.mf4") as mdf:
        units = {
            name: mdf.get(name).unit for name in ("fork_stroke_mm", "pitch_rate_dps", "speed_kmh", "time")
        }
        units["acc"] = mdf.get("acc_body_ms2").unit
    assert units == {
        "fork_stroke_mm": "mm",
        "pitch_rate_dps": "deg/s",
        "speed_kmh": "km/h",
        "time": "s",
        "acc": "m/s2",
    }


def test_without_asammdf_the_command_that_helps_is_named(tmp_path, monkeypatch):
    """Reading and writing say what to install."""
    path = mf4(tmp_path, [signal("fork_stroke_mm")])
    monkeypatch.setattr("bench.laps.mdf.mf4.find_spec", lambda name: None)
    for act in (
        lambda: read(path),
        lambda: write_lap(Lap(np.arange(2), {"speed_kmh": np.zeros(2)}), tmp_path / "a.mf4"),
    ):
        with pytest.raises(LapError, match=r"needs asammdf: pip install 'strokebench\[mdf\]'"):
            act()


def test_nothing_is_printed(tmp_path, capfd, caplog):
    """asammdf's own words on a damaged file stay with asammdf."""
    path = mf4(tmp_path, [signal("fork_stroke_mm")])
    read(path)
    patched(path, block(path, b"CN") + 88, "<4B", 0, 0, 4, 3)
    with pytest.raises(LapError):
        read(path)
    assert (capfd.readouterr(), caplog.records) == (("", ""), [])
