"""A lap through its sensors: ideal ones, those of the data sheets, and where their randomness comes from."""

import numpy as np
import pytest

from bench.errors import SensorError
from bench.laps.lap import Lap
from bench.sensors.codes import acquire
from bench.sensors.datasheets import load_sensors
from bench.sensors.parts import IDEAL, Encoder, Logger, Mems, Potentiometer, Sensors
from bench.sensors.streams import streams, time_base
from bench.sensors.transducers import BY_CHANNEL, TRANSDUCERS
from dbc import CHANNELS

MS = 1_000_000
DATASHEET = load_sensors("datasheet")
GYRO = Sensors("test", {"L3GD20": Mems(noise_density=0.03, zero_level=1.0)})


def lap_of(channels=CHANNELS, samples=3000, start_ns=0, seed=0, t_ns=None):
    """A lap in the middle of every sensor's span."""
    t_ns = start_ns + np.arange(samples) * MS if t_ns is None else t_ns
    t = (t_ns - t_ns[0]) * 1e-9
    middle = {"fork_stroke_mm": 60.0, "rear_stroke_mm": 55.0, "speed_kmh": 80.0}
    values = {
        name: middle.get(name, 0.0) + 10.0 * np.sin(2 * np.pi * (1 + k) * t + seed)
        for k, name in enumerate(CHANNELS)
    }
    return Lap(t_ns, {name: values[name] for name in channels})


def same(a, b, sensors=None):
    names = a.codes if sensors is None else sensors
    return all(np.array_equal(a.codes[name], b.codes[name]) for name in names)


def test_ideal_is_the_rounded_truth():
    """Ideal sensors give the rounded true values."""
    lap = lap_of()
    codes = acquire(lap, load_sensors("ideal"), seed=9)
    assert same(codes, acquire(lap))
    for name, values in lap.channels.items():
        row = BY_CHANNEL[name]
        if row.ratiometric:
            exact = row.code_max * ((values - row.low) / (row.high - row.low))
        else:
            exact = values / row.per_code
        assert np.array_equal(codes.codes[row.sensor], np.rint(exact))


def test_parts_without_figures_are_ideal():
    """A part that is all defaults changes no code."""
    blank = Sensors(
        "blank", {"SLS130": Potentiometer(), "L3GD20": Mems(), "LIS331HH": Mems()}, logger=Logger()
    )
    lap = lap_of([name for name in CHANNELS if name != "speed_kmh"])
    assert same(acquire(lap, blank), acquire(lap))


def test_every_sensor_is_imperfect():
    """With the data sheets' figures no sensor gives the true codes, and none is far from them."""
    lap = lap_of()
    measured, true = acquire(lap, DATASHEET), acquire(lap)
    for sensor, codes in measured.codes.items():
        error = np.abs(codes - true.codes[sensor])
        assert error.any()
        assert error.max() < {"pitch_rate": 700, "speed": 400}.get(sensor, 30)


def test_same_seed_same_bytes():
    """The same lap and seed give the same bytes, another seed others."""
    lap = lap_of()
    assert same(acquire(lap, DATASHEET, 4), acquire(lap, DATASHEET, 4))
    other = acquire(lap, DATASHEET, 5)
    assert not any(same(acquire(lap, DATASHEET, 4), other, [sensor]) for sensor in other.codes)


def test_every_lap_has_its_own_noise():
    """Two laps have different noise with the same seed."""
    part = Sensors("test", {"L3GD20": Mems(zero_level=1.0)})
    zeros = [
        acquire(lap, part).codes["pitch_rate"] - acquire(lap).codes["pitch_rate"]
        for lap in (lap_of(seed=0), lap_of(seed=1))
    ]
    assert abs(zeros[0][0] - zeros[1][0]) > 2


def test_start_of_the_clock_does_not_matter():
    """A lap whose time starts later has the same codes."""
    assert same(acquire(lap_of(), DATASHEET), acquire(lap_of(start_ns=5_000 * MS), DATASHEET))


@pytest.mark.parametrize("channel", CHANNELS)
def test_channels_are_independent(channel):
    """A channel's codes do not depend on which others the lap has."""
    alone = acquire(lap_of([channel]), DATASHEET)
    assert same(alone, acquire(lap_of(), DATASHEET))


def test_alike_channels_differ():
    """Two accelerometers that feel the same do not have the same noise."""
    lap = Lap(np.arange(1000) * MS, {name: np.zeros(1000) for name in ("acc_front_ms2", "acc_rear_ms2")})
    codes = acquire(lap, DATASHEET).codes
    assert abs(np.corrcoef(codes["acc_front"], codes["acc_rear"])[0, 1]) < 0.15


def test_imperfections_are_independent():
    """Taking the noise away leaves the zero level as it was."""
    lap = Lap(np.arange(200_000) * MS, {"pitch_rate_dps": np.zeros(200_000)})
    noisy = acquire(lap, GYRO).codes["pitch_rate"]
    quiet = acquire(lap, Sensors("test", {"L3GD20": Mems(zero_level=1.0)})).codes["pitch_rate"]
    assert np.ptp(quiet) == 0
    assert noisy.mean() == pytest.approx(quiet[0], abs=1.0)


PINNED = 8956266052117750834


def test_streams_are_pinned():
    """The generator of an imperfection is the same in every process and version."""
    draw = streams(7, time_base(np.arange(3, dtype=np.int64)), "pitch_rate", np.zeros(3))
    assert draw("noise").bit_generator.random_raw() == PINNED
    assert draw("zero").bit_generator.random_raw() != PINNED


def test_negative_seed():
    """A negative seed is refused by value."""
    with pytest.raises(SensorError, match="seed -3 is below zero"):
        acquire(lap_of(), DATASHEET, -3)


def test_saturation_is_counted():
    """Beyond 24 g an accelerometer stays at its end code, and those samples are counted."""
    values = np.zeros(1000)
    values[100:350] = 300.0
    values[600:700] = -300.0
    codes = acquire(Lap(np.arange(1000) * MS, {"acc_front_ms2": values}), DATASHEET)
    assert codes.saturated == {"acc_front": 350}
    assert set(codes.codes["acc_front"][100:350].tolist()) == {2000}
    assert set(codes.codes["acc_front"][600:700].tolist()) == {-2000}


@pytest.mark.parametrize("wild", [1e300, -1e300])
def test_wild_value(wild):
    """One wild sample saturates a sensor for no longer than its low-pass or timer remembers."""
    values = {name: array.copy() for name, array in lap_of().channels.items()}
    for array in values.values():
        array[1000] = wild
    measured = acquire(Lap(np.arange(3000) * MS, values), DATASHEET)
    healthy = acquire(lap_of(), DATASHEET)
    for sensor, codes in measured.codes.items():
        row = TRANSDUCERS[sensor]
        assert codes.min() >= row.code_min
        assert codes.max() <= row.code_max
        assert np.abs(codes[1050:] - healthy.codes[sensor][1050:]).max() < (row.code_max - row.code_min) / 30


def test_irregular_lap():
    """A lap with jitter and a gap goes through every sensor and stays as near the truth as a regular one."""
    steps = np.random.default_rng(0).integers(MS // 2, 3 * MS // 2, 3000)
    steps[1500] = 700 * MS
    lap = lap_of(t_ns=np.concatenate([[0], np.cumsum(steps)]))
    measured, true = acquire(lap, DATASHEET), acquire(lap)
    for sensor in ("fork_stroke", "rear_stroke", "acc_front", "acc_rear", "acc_body"):
        assert np.abs(measured.codes[sensor] - true.codes[sensor]).max() < 40
    assert np.abs(measured.codes["pitch_rate"] - true.codes["pitch_rate"]).max() < 700


def test_arrays_are_read_only():
    """Measured codes cannot be written to."""
    codes = acquire(lap_of(), DATASHEET)
    with pytest.raises(ValueError, match="read-only"):
        codes.codes["speed"][0] = 1


def test_digest():
    """The digest of sensors is that of their figures, not of their name."""
    assert Sensors("a", GYRO.parts).digest() == Sensors("b", GYRO.parts).digest()
    others = [
        IDEAL,
        GYRO,
        DATASHEET,
        Sensors("x", {"L3GD20": Mems(noise_density=0.031, zero_level=1.0)}),
        Sensors("x", {"970-011": Encoder(48, 1.9)}),
        Sensors("x", logger=Logger(noise_lsb=1.0)),
    ]
    assert len({each.digest() for each in others}) == len(others)
