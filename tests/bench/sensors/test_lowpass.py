"""The low-pass on regular and irregular time bases."""

import math

import numpy as np
import pytest
from scipy import signal

from bench.sensors.lowpass import delay_s, lowpass, noise_bandwidth_hz

MS = 1_000_000
BOTH = pytest.mark.parametrize("order", [1, 2])


def settled(t_ns, u, hz, order=2):
    return lowpass(np.asarray(t_ns, dtype=np.int64), u, hz, order, u[0], 0.0)


def uneven(samples, seed=0):
    """Steps between 0.5 and 1.5 ms."""
    steps = np.random.default_rng(seed).integers(MS // 2, 3 * MS // 2, samples)
    return np.concatenate([[0], np.cumsum(steps)])


def response(t_ns, hz, frequency_hz, order=2):
    """The complex gain at one frequency, by least squares over the settled part."""
    phase = 2e-9 * np.pi * frequency_hz * t_ns
    out = settled(t_ns, np.sin(phase), hz, order)
    late = t_ns > 0.2e9
    basis = np.stack([np.sin(phase), np.cos(phase)], axis=1)[late]
    sine, cosine = np.linalg.lstsq(basis, out[late], rcond=None)[0]
    return sine + 1j * cosine


@BOTH
@pytest.mark.parametrize("hz", [20.0, 150.0, 420.0])
def test_scipy_on_a_regular_base(order, hz):
    """On a regular time base the output is that of scipy's Butterworth filter of the same cut-off."""
    u = np.random.default_rng(1).standard_normal(2000)
    u[0] = 0.0
    b, a = signal.butter(order, hz, fs=1000.0)
    assert np.allclose(settled(np.arange(2000) * MS, u, hz, order), signal.lfilter(b, a, u), atol=1e-10)


@BOTH
def test_three_decibels_at_the_cutoff(order):
    """A sine at the cut-off comes out with half its power."""
    gain = abs(response(np.arange(3000) * MS, 150.0, 150.0, order))
    assert gain == pytest.approx(math.sqrt(0.5), abs=1e-6)


@BOTH
def test_delay(order):
    """A ramp comes out later by the delay that is stated, at 1 kHz and in continuous time."""
    for step_ns in (MS, MS // 100):
        t_ns = np.arange(100 * MS // step_ns) * step_ns
        late = t_ns[-1] * 1e-9 - settled(t_ns, t_ns * 1e-9, 150.0, order)[-1]
        assert late == pytest.approx(delay_s(150.0, order, step_ns * 1e-9), rel=1e-9)
    assert late == pytest.approx(delay_s(150.0, order), rel=1e-4)
    assert delay_s(150.0, 2) == pytest.approx(1.5e-3, rel=1e-3)


@pytest.mark.parametrize("frequency_hz", [10.0, 60.0])
def test_irregular_base(frequency_hz):
    """With steps of 0.5 to 1.5 ms the gain is the analogue filter's within 3 % and 0.1 ms."""
    gain = response(uneven(5000), 150.0, frequency_hz)
    b, a = signal.butter(2, 2 * np.pi * 150.0, analog=True)
    exact = signal.freqs(b, a, [2 * np.pi * frequency_hz])[1][0]
    assert abs(gain) == pytest.approx(abs(exact), rel=0.03)
    assert abs(np.angle(gain / exact)) < 2 * np.pi * frequency_hz * 2e-4


def test_a_gap_settles():
    """After a gap longer than the filter remembers the output is the sample itself, not an overshoot."""
    t_ns = np.array([0, 1, 2, 1000, 1001]) * MS
    out = settled(t_ns, np.array([0.0, 0.0, 0.0, 7.0, 7.0]), 150.0)
    assert out == pytest.approx([0.0, 0.0, 0.0, 7.0, 7.0], abs=1e-12)


def test_slow_lap_passes():
    """A lap too slow for the cut-off passes as it is, and the stated delay is zero."""
    u = np.random.default_rng(2).standard_normal(50)
    assert np.array_equal(settled(np.arange(50) * 10 * MS, u, 150.0), u)
    assert delay_s(150.0, 2, 0.01) == 0.0


@BOTH
def test_noise_bandwidth(order):
    """The noise bandwidth is the integral of the power gain."""
    b, a = signal.butter(order, 1.0, analog=True)
    w = np.linspace(0.0, 4000.0, 2_000_001)
    power = np.abs(signal.freqs(b, a, w)[1]) ** 2
    assert noise_bandwidth_hz(100.0, order) == pytest.approx(100.0 * np.trapezoid(power, w), rel=1e-3)
