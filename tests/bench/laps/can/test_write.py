"""Laps written as CAN logs: what the logger would send during the ride."""

import numpy as np
import pytest

from bench.errors import LapError
from bench.laps.files import format_of, read_lap, write_lap
from bench.sensors.transducers import BY_CHANNEL
from tests.conftest import wavy_lap


def read(path):
    return format_of(path).read(path)


@pytest.mark.parametrize("suffix", [".asc", ".blf", ".log"])
def test_a_lap_travels_as_the_logger_would_send_it(tmp_path, suffix):
    """A written lap comes back at 100 Hz within one code of its own values at the same instants."""
    lap = wavy_lap(2.0)
    write_lap(lap, tmp_path / f"lap{suffix}")
    recording = read(tmp_path / f"lap{suffix}")
    assert recording.damage == ()
    assert list(recording.tracks) == list(lap.channels)
    for name, track in recording.tracks.items():
        assert track.t_ns.tolist() == lap.t_ns[::10].tolist()
        assert np.abs(track.values - lap.channels[name][::10]).max() <= BY_CHANNEL[name].per_code
    assert [path.name for path in tmp_path.iterdir()] == [f"lap{suffix}"]


@pytest.mark.parametrize("suffix", [".asc", ".blf", ".log"])
def test_the_same_lap_gives_the_same_log(tmp_path, suffix):
    """Writing a lap twice gives two identical logs."""
    for name in "ab":
        write_lap(wavy_lap(0.5), tmp_path / f"{name}{suffix}")
    assert (tmp_path / f"a{suffix}").read_bytes() == (tmp_path / f"b{suffix}").read_bytes()


def test_a_log_of_a_lap_is_a_lap(tmp_path):
    """A written log is read as a lap at its 100 Hz."""
    write_lap(wavy_lap(1.0), tmp_path / "lap.log")
    assert set(np.diff(read_lap(tmp_path / "lap.log").t_ns)) == {10_000_000}


@pytest.mark.parametrize(
    ("names", "says"),
    [
        (("fork_stroke_mm",), "lap: fork_stroke_mm would be lost: message STROKES also wants rear_stroke_mm"),
        (
            ("fork_stroke_mm", "rear_stroke_mm", "speed_kmh"),
            "lap: speed_kmh would be lost: message MOTION also",
        ),
    ],
)
def test_channels_that_no_message_carries_alone_are_named(tmp_path, names, says):
    """A lap whose channels the layout cannot carry is refused by their names, nothing is written."""
    with pytest.raises(LapError, match=says):
        write_lap(wavy_lap(0.5, names), tmp_path / "lap.log")
    assert list(tmp_path.iterdir()) == []


def test_a_lap_of_whole_messages_is_written(tmp_path):
    """Channels that are missing with their whole message are no hindrance."""
    write_lap(wavy_lap(0.5, ("fork_stroke_mm", "rear_stroke_mm")), tmp_path / "lap.log")
    assert list(read(tmp_path / "lap.log").tracks) == ["fork_stroke_mm", "rear_stroke_mm"]
