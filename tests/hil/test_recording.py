"""A recorded run, read by others' means: python-can reads the log, cantools decodes it, out comes the lap."""

from pathlib import Path

import can
import cantools
import numpy as np
import pytest

import bench.laps
from bench.codec import Codec
from bench.laps.channel_map import load_map
from bench.laps.files import read_lap, write_lap
from bench.laps.lap import CHANNELS, Lap
from bench.mdlog.logger import NODE, schedule
from bench.recorder import record
from bench.rig import ride
from bench.sensors.codes import acquire
from bench.watch import Watch
from dbc import MOTORCYCLE
from targets.calibration import dumps
from tests.conftest import SHARED, wavy_lap

SST = SHARED / "data" / "sufni-mtb-sst" / "00647.SST"
GEOMETRY = Path(bench.laps.__file__).parent / "maps" / "clash2022.toml"
DATABASE = cantools.database.load_file(MOTORCYCLE)


def decoded(path):
    """Signal -> float64 (cycles,), of every frame of the logger in a log, in the order of the log."""
    found: dict[str, list[float]] = {}
    with can.LogReader(path) as log:
        for message in log:
            definition = DATABASE.get_message_by_frame_id(message.arbitration_id)
            if definition.senders == [NODE]:
                for name, value in definition.decode(message.data).items():
                    found.setdefault(name, []).append(value)
    return {name: np.array(values) for name, values in found.items()}


def least_bit(channel):
    """What one bit of the channel's signal is worth."""
    return next(s.scale for m in DATABASE.messages for s in m.signals if s.name == channel)


def close(lap, channel, values):
    """Each value is the lap's at its 10 ms, within one least significant bit."""
    at = np.arange(0, lap.duration_ns + 1, 10_000_000)
    expected = lap.channels[channel][np.searchsorted(lap.t_ns - lap.t_ns[0], at)]
    assert values.shape == expected.shape
    assert np.abs(values - expected).max() <= least_bit(channel)
    assert np.ptp(values) > 100 * least_bit(channel)


class Nobody:
    """On the bus, and silent."""

    name = "nobody"

    def advance(self, t_ns):
        return None

    def receive(self, frame, t_ns):
        pass

    def sent(self, handle, t_ns):
        pass

    def where(self):
        return ""


class Patient(Watch):
    """Expects no answer."""

    def unanswered(self, t_ns):
        return None


@pytest.fixture
def lap():
    """What `bench` rides."""
    return wavy_lap(1.0)


@pytest.fixture(scope="module")
def mountain_bike():
    """The recording's strokes as a lap at 1 kHz, in mm, within the sensors' spans."""
    if not SST.exists():
        pytest.skip(f"no recording {SST.name}: it is not part of the repository")
    lap = read_lap(SST, load_map(GEOMETRY))
    spans = {"fork_stroke_mm": 150.0, "rear_stroke_mm": 110.0}
    return Lap(lap.t_ns, {name: np.clip(lap.channels[name], 0, top) for name, top in spans.items()}, SST.name)


def test_recorded_ride_comes_back(mountain_bike, tmp_path):
    """A minute of a real bicycle's strokes goes over the bus; what cantools decodes is what was ridden."""
    watch = Patient(Codec())
    done = ride(schedule(acquire(mountain_bike), Codec()), Nobody(), watch)
    assert done.failure is None
    record(tmp_path / "ride.log", [(d.t_end_ns, d.frame, d.node) for d in done.frames])
    values = decoded(tmp_path / "ride.log")
    assert set(values) == {"fork_stroke_mm", "rear_stroke_mm", "alive"}
    for channel in ("fork_stroke_mm", "rear_stroke_mm"):
        close(mountain_bike, channel, values[channel])
    np.testing.assert_array_equal(values["alive"], np.arange(len(values["alive"])) % 16)


def test_recorded_ride_is_no_lap_for_the_ifd(mountain_bike, tmp_path, command):
    """The IFD is refused that ride in one line that names the channels it lacks."""
    write_lap(mountain_bike, tmp_path / "ride.csv")
    said = command("run", tmp_path / "ride.csv", "--json", tmp_path / "out.json")
    assert said.code == 2
    assert said.err == "bench: lap: ride.csv: missing pitch_rate_dps, speed_kmh, needed by ecu ifd\n"
    assert not (tmp_path / "out.json").exists()


@pytest.mark.parametrize("suffix", [".log", ".blf"])
def test_seven_channels_come_back(command, calibration, tmp_path, suffix):
    """A run recorded by the command decodes to all seven channels of its lap."""
    lap = wavy_lap(2.0)
    write_lap(lap, tmp_path / "lap.parquet")
    (tmp_path / "model.json").write_text(dumps(calibration))
    out = tmp_path / f"out{suffix}"
    model = tmp_path / "model.json"
    command("run", tmp_path / "lap.parquet", "--sensors", "ideal", "--model", model, "--record", out)
    values = decoded(out)
    for channel in CHANNELS:
        close(lap, channel, values[channel])


def test_answers_are_recorded(bench, bus, tmp_path):
    """The ECU's own frames are in the recording, and cantools decodes them: one status for each cycle."""
    bench.finish()
    record(tmp_path / "out.log", bus.frames)
    with can.LogReader(tmp_path / "out.log") as log:
        status = [DATABASE.decode_message(m.arbitration_id, m.data) for m in log if m.arbitration_id == 0x200]
    assert [values["alive"] for values in status] == [k % 16 for k in range(100)]
    assert all(0 < values["predicted_mm"] < 110 for values in status)
    np.testing.assert_array_equal(
        bus.signal("IFD_STATUS.predicted_mm").values, [values["predicted_mm"] for values in status]
    )
