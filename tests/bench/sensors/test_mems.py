"""Gyroscope and accelerometers as instruments: noise, zero level, slope, curve, output rate."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from bench.laps.lap import Lap
from bench.sensors.codes import acquire
from bench.sensors.datasheets import load_sensors
from bench.sensors.lowpass import noise_bandwidth_hz
from bench.sensors.parts import Mems, Sensors
from bench.sensors.transducers import BY_CHANNEL

MS = 1_000_000
GYRO = load_sensors("datasheet").parts["L3GD20"]
ACCELEROMETER = load_sensors("datasheet").parts["LIS331HH"]


def measured(part, values, channel="pitch_rate_dps", seed=0, step_ns=MS):
    """Physical values that `part` gives of true ones at a regular time base."""
    transducer = BY_CHANNEL[channel]
    t_ns = np.arange(len(values)) * step_ns
    codes = acquire(Lap(t_ns, {channel: values}), Sensors("test", {transducer.model: part}), seed)
    return transducer.to_physical(codes.codes[transducer.sensor])


def test_noise_density():
    """The gyroscope's noise has the data sheet's density in its band, and the low-pass's colour above."""
    part = Mems(noise_density=GYRO.noise_density, lowpass_hz=GYRO.lowpass_hz)
    noise = measured(part, np.zeros(400_000))
    f, power = signal.welch(noise, fs=1000.0, nperseg=1000)
    b, a = signal.butter(2, GYRO.lowpass_hz, fs=1000.0)
    expected = GYRO.noise_density**2 * np.abs(signal.freqz(b, a, f, fs=1000.0)[1]) ** 2
    for low, high in ((2, 50), (60, 140), (200, 300)):
        band = (f >= low) & (f <= high)
        # some 440 independent averages of each line: 0.5 % for 80 lines
        assert np.mean(power[band] / expected[band]) == pytest.approx(1.0, abs=0.03)


def test_noise_of_the_accelerometer():
    """At 1 kHz the accelerometer's noise is its density over half its output rate."""
    part = replace(Mems(), unit=ACCELEROMETER.unit, noise_density=0.65, lowpass_hz=780.0, odr_hz=1000.0)
    noise = measured(part, np.zeros(100_000), "acc_front_ms2")
    step = BY_CHANNEL["acc_front_ms2"].per_code
    sigma = np.sqrt(0.65e-3**2 * 500.0 * 9.80665**2 + step**2 / 12.0)
    assert noise.std() == pytest.approx(sigma, rel=0.02)


def test_noise_of_a_slow_lap():
    """Sampled at 100 Hz, all the noise of the gyroscope's band folds into each sample."""
    noise = measured(Mems(noise_density=0.03, lowpass_hz=100.0), np.zeros(50_000), step_ns=10 * MS)
    assert noise.std() == pytest.approx(0.03 * np.sqrt(noise_bandwidth_hz(100.0, 2)), rel=0.02)
    assert abs(np.corrcoef(noise[1:], noise[:-1])[0, 1]) < 0.02


def test_noise_without_a_lowpass():
    """Without a low-pass the noise reaches up to half the sensor's own output rate."""
    noise = measured(Mems(noise_density=0.03, odr_hz=100.0), np.zeros(500_000))
    assert noise.std() == pytest.approx(0.03 * np.sqrt(50.0), rel=0.02)


def test_noise_is_stationary_from_the_first_sample():
    """Over many laps the first sample scatters as much as later ones."""
    part = Mems(noise_density=0.03, lowpass_hz=100.0)
    first = [measured(part, np.zeros(2), seed=seed)[0] for seed in range(500)]
    assert np.std(first) == pytest.approx(0.03 * np.sqrt(noise_bandwidth_hz(100.0, 2)), rel=0.13)


def test_zero_level_over_many_seeds():
    """The zero level scatters around zero with the sigma asked for and stays the same within a lap."""
    laps = np.array([measured(Mems(zero_level=0.5), np.zeros(3), seed=seed) for seed in range(600)])
    assert np.ptp(laps, axis=1).max() == 0.0
    assert abs(laps[:, 0].mean()) < 4.0 * 0.5 / np.sqrt(600)
    assert laps[:, 0].std() == pytest.approx(0.5, rel=4.0 / np.sqrt(2 * 600))


def test_warming_up():
    """The zero level drifts with the temperature, from zero to its share after a time constant."""
    part = Mems(zero_per_k=0.03, warming_k=10.0, warming_s=50.0)
    laps = [measured(part, np.zeros(51), seed=seed, step_ns=1000 * MS) for seed in range(500)]
    start, end = np.array(laps)[:, 0], np.array(laps)[:, -1]
    assert np.abs(start).max() == 0.0
    assert end.std() == pytest.approx(0.3 * (1.0 - np.exp(-1.0)), rel=4.0 / np.sqrt(1000))


def test_random_walk():
    """The random walk's spread grows with the root of time."""
    part = Mems(zero_walk=0.2)
    laps = np.array([measured(part, np.zeros(101), seed=seed, step_ns=1000 * MS) for seed in range(500)])
    for k in (25, 100):
        assert laps[:, k].std() == pytest.approx(0.2 * np.sqrt(k), rel=4.0 / np.sqrt(1000))


def test_sensitivity():
    """The slope's error scatters with its sigma, the same at every rate of one lap."""
    truth = np.array([-100.0, 0.0, 200.0])
    laps = np.array([measured(Mems(sensitivity=0.01), truth, seed=seed) for seed in range(600)])
    slopes = (laps[:, 2] / 200.0) - 1.0
    assert slopes.std() == pytest.approx(0.01, rel=4.0 / np.sqrt(1200))
    assert np.abs(laps[:, 0] + laps[:, 2] / 2.0).max() < 0.0175
    assert np.abs(laps[:, 1]).max() == 0.0


def test_nonlinearity():
    """The curve stays within its limit of the full scale, is zero at rest, and some specimen uses it up."""
    truth = np.linspace(-250.0, 250.0, 1001)
    errors = np.array([measured(Mems(nonlinearity=0.002), truth, seed=s) - truth for s in range(100)])
    worst = np.abs(errors).max(axis=1)
    assert worst.max() <= 0.5 + 0.00875
    assert worst.max() > 0.45
    assert np.abs(errors[:, 500]).max() < 0.00875


def test_output_rate():
    """A sensor of 100 Hz read at 1 kHz gives each value ten times, never one from the future."""
    truth = np.arange(1000) * 0.01
    held = measured(Mems(odr_hz=100.0), truth)
    runs = np.diff(np.flatnonzero(np.diff(held)))
    assert set(runs.tolist()) == {10}
    assert (held <= truth + 0.005).all()
    assert (truth - held < 0.1).all()


def test_delay_of_the_gyroscope():
    """A ramp is measured late by the low-pass's delay."""
    truth = 100.0 * np.arange(1000) * 1e-3
    late = (truth - measured(Mems(lowpass_hz=100.0), truth))[-100:].mean() / 100.0
    assert late == pytest.approx(2.18e-3, abs=0.05e-3)
