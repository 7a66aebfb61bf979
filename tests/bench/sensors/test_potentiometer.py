"""The stroke potentiometers as instruments: track, play, supply and reference, converter."""

import numpy as np
import pytest

from bench.laps.lap import Lap
from bench.sensors.codes import acquire
from bench.sensors.datasheets import load_sensors
from bench.sensors.parts import IDEAL, Logger, Potentiometer, Sensors

MS = 1_000_000
RAMP = np.linspace(0.0, 150.0, 5001)
DATASHEET = load_sensors("datasheet")


def codes(sensors, stroke_mm, seed=0):
    lap = Lap(np.arange(len(stroke_mm)) * MS, {"fork_stroke_mm": stroke_mm})
    return acquire(lap, sensors, seed).codes["fork_stroke"]


def track(**figures):
    return Sensors("test", {"SLS130": Potentiometer(**figures)})


def converter(**figures):
    return Sensors("test", logger=Logger(**figures))


def error(sensors, stroke_mm, seed=0):
    return codes(sensors, stroke_mm, seed) - codes(IDEAL, stroke_mm)


def test_linearity():
    """No specimen leaves the independent linearity, some come near it, and the ends are true."""
    errors = np.array([error(track(linearity=0.0025), RAMP, seed) for seed in range(100)])
    worst = np.abs(errors).max(axis=1)
    assert worst.max() <= 0.0025 * 4095 + 1
    assert worst.max() > 0.9 * 0.0025 * 4095
    assert np.abs(errors[:, [0, -1]]).max() == 0


def test_linearity_is_smooth():
    """A curve of four half waves changes no faster than the fastest of them would (Bernstein)."""
    errors = error(track(linearity=0.0025), RAMP, 3)
    in_3_mm = np.abs(errors[100:] - errors[:-100]).max()
    assert in_3_mm <= 4 * np.pi * 0.0025 * 4095 * 3.0 / 150.0 + 1


def test_smoothness():
    """The track's texture stays within its peak to peak, needs motion, and is the same on the way back."""
    sensors = track(smoothness=0.001)
    there = np.concatenate([RAMP, RAMP[::-1]])
    errors = error(sensors, there)
    assert np.abs(errors).max() <= 0.0005 * 4095 + 1
    assert errors.std() > 0.5
    assert np.array_equal(errors[:5001], errors[:5000:-1])
    assert np.ptp(codes(sensors, np.full(100, 70.0))) == 0


def test_hysteresis():
    """Coming from above and from below, the same stroke reads apart by the play."""
    there = np.concatenate([RAMP, RAMP[::-1]])
    apart = (
        codes(track(hysteresis_mm=1.0), there)[:5001] - codes(track(hysteresis_mm=1.0), there)[:5000:-1]
    )[200:-200]
    assert np.abs(apart + 1.0 * 4095 / 150.0).max() <= 1


def test_play_alone_is_half_within():
    """The play moves no reading by more than half of it."""
    wander = 75.0 + 30.0 * np.cumsum(np.random.default_rng(0).standard_normal(5000)) / 100.0
    assert np.abs(error(track(hysteresis_mm=1.0), wander)).max() <= 0.5 * 4095 / 150.0 + 1


def test_supply_cancels():
    """Tolerance and ripple of the supply change no code where the reference is the same rail."""
    assert not error(converter(supply_tolerance=0.1, supply_ripple=0.05), RAMP).any()


def test_supply_shows_with_a_fixed_reference():
    """With a reference of its own the converter sees tolerance and ripple."""
    fixed = {"reference_follows": 0.0}
    steady = np.full(2000, 100.0)
    assert np.ptp(error(converter(supply_tolerance=0.1, **fixed), steady)) == 0
    scatter = [error(converter(supply_tolerance=0.1, **fixed), steady, s)[0] for s in range(50)]
    assert 0.05 * 2730 < np.abs(scatter).max() <= 0.1 * 2730 + 1
    ripple = error(converter(supply_ripple=0.05, ripple_hz=97.0, **fixed), steady)
    assert ripple.max() == pytest.approx(0.05 * 2730, abs=1.5)
    assert ripple.min() == pytest.approx(-0.05 * 2730, abs=1.5)


def test_reference_that_lags():
    """Of the supply's deviation that share remains which the reference does not follow."""
    ripple = error(converter(supply_ripple=0.1, ripple_hz=97.0, reference_follows=0.9), np.full(2000, 140.0))
    assert ripple.max() == pytest.approx(0.01 / 1.09 * 3822, abs=1.5)
    assert ripple.min() == pytest.approx(-0.01 / 0.91 * 3822, abs=1.5)


def test_mismatch_remains():
    """What the reference deviates from the supply is an error of the slope."""
    full = [error(converter(reference_mismatch=0.01), np.full(2, 75.0), s)[0] for s in range(500)]
    assert np.std(full) == pytest.approx(0.01 * 2047.5, rel=0.13)


def test_converter_noise():
    """The converter's noise is new at each conversion and as large as asked for, rounding included."""
    noise = error(converter(noise_lsb=2.0), np.full(50_000, 75.0))
    assert noise.std() == pytest.approx(np.sqrt(4.0 + 1.0 / 12.0), rel=0.02)
    assert abs(np.corrcoef(noise[1:], noise[:-1])[0, 1]) < 0.02


def test_converter_linearity():
    """The converter's non-linearity stays within its limit."""
    worst = [np.abs(error(converter(inl_lsb=3.0), RAMP, seed)).max() for seed in range(50)]
    assert 2 <= max(worst) <= 4


def test_lowpass_delay():
    """A stroke that moves at 1 m/s is measured 1.39 ms late at 1 kHz."""
    ramp = np.arange(150) * 1.0
    late = error(track(lowpass_hz=150.0), ramp)[50:-5] * 150.0 / 4095
    assert late.mean() == pytest.approx(-1.388, abs=0.02)


def test_noise_at_full_extension_saturates():
    """At the end of the stroke the converter's noise runs into the end code, which is counted."""
    lap = Lap(np.arange(10_000) * MS, {"fork_stroke_mm": np.zeros(10_000)})
    measured = acquire(lap, converter(noise_lsb=3.0))
    assert measured.codes["fork_stroke"].min() == 0
    assert 0.3 < measured.saturated["fork_stroke"] / 10_000 < 0.5


def test_both_ends_differ():
    """Fork and rear have specimens of their own."""
    lap = Lap(np.arange(5001) * MS, {"fork_stroke_mm": RAMP, "rear_stroke_mm": RAMP * 110.0 / 150.0})
    both = acquire(lap, track(linearity=0.0025)).codes
    assert not np.array_equal(both["fork_stroke"], both["rear_stroke"])
