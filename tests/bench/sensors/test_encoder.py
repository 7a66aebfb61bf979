"""The wheel speed sensor: teeth, pulses, timer, and the rule when no pulse comes."""

import numpy as np
import pytest

from bench.laps.lap import Lap
from bench.sensors.codes import acquire
from bench.sensors.encoder import pulses, readings, tooth_edges
from bench.sensors.parts import Encoder, Sensors

MS = 1_000_000
RING = Encoder(teeth=48, circumference_m=1.92, tick_s=1e-9)  # 4 cm from tooth to tooth
PITCH_KMH = 0.04 * 3.6
ROUGH = Encoder(teeth=48, circumference_m=1.92, edge_error=0.02, runout=0.3, tick_s=1e-9)


def kmh(part, speed_kmh, step_ns=MS, seed=0):
    speed_kmh = np.asarray(speed_kmh, dtype=np.float64)
    lap = Lap(np.arange(len(speed_kmh)) * step_ns, {"speed_kmh": speed_kmh})
    return acquire(lap, Sensors("test", {"970-011": part}), seed).codes["speed"] * 0.01


def times(part, speed_kmh, step_ns=MS, start=3.2):
    t_ns = np.arange(len(speed_kmh)) * step_ns
    edges = tooth_edges(part, np.random.default_rng(5))
    return pulses(t_ns, np.asarray(speed_kmh) / PITCH_KMH, edges, start)


def test_perfect_ring_reads_true():
    """A perfect ring at constant speed gives that speed, from the first sample on."""
    assert np.abs(kmh(RING, np.full(2000, 87.65)) - 87.65).max() <= 0.01


def test_whole_revolutions_are_exact():
    """Whatever the teeth's errors, the time of whole revolutions is the way over the speed."""
    at = times(ROUGH, np.full(3000, 72.0))
    assert np.abs(np.diff(at) * 72.0 / PITCH_KMH - 1.0).max() > 0.02
    assert at[48:] - at[:-48] == pytest.approx(1.92 / 20.0, rel=1e-9)


def test_mean_slowness_is_exact():
    """Over whole revolutions the mean of the inverse readings, one a pulse, is the inverse of the speed."""
    t_ns = np.arange(12_000) * MS // 10
    at = times(ROUGH, np.full(12_000, 72.0), step_ns=MS // 10)
    read = readings(t_ns, at, 1e-9, 0.5) * PITCH_KMH
    after = np.ceil(at[at > 0.0] / 1e-4).astype(int)[: 10 * 48]  # the sample that first knows of a pulse
    assert np.ptp(read) > 1.0
    assert np.mean(1.0 / read[after]) == pytest.approx(1.0 / 72.0, rel=1e-6)


def test_errors_repeat_each_revolution():
    """The ring's errors come back after a revolution."""
    fast = kmh(ROUGH, np.full(4 * 960, 72.0), step_ns=MS // 10)
    assert np.ptp(fast) > 1.0
    assert np.array_equal(fast[960 : 2 * 960], fast[2 * 960 : 3 * 960])


def test_pulses_of_an_acceleration():
    """Under constant acceleration the pulses come at the roots of the parabola."""
    speed = 36.0 * np.arange(1001) * 1e-3  # to 10 m/s in 1 s
    at = times(RING, speed, start=0.0)
    at = at[np.isfinite(at)]
    tooth = np.arange(1, len(at) + 1)
    assert len(at) == 125
    assert at == pytest.approx(np.sqrt(2.0 * 0.04 * tooth / 10.0), abs=1e-9)


def test_steps_at_low_speed():
    """At low speed the reading is a staircase with a step for each pulse."""
    speed = np.linspace(2.0, 4.0, 1000)
    read = kmh(RING, speed)
    at = times(RING, speed)
    steps = np.count_nonzero(np.diff(read))
    assert steps <= np.count_nonzero(at > 0.0) + 1
    assert steps >= 15
    assert np.abs(read - speed).max() < 0.25


def test_decay_without_pulses():
    """When the wheel stops the reading falls as the pitch over the wait and ends at zero."""
    speed = np.concatenate([np.full(1000, 36.0), np.zeros(1500)])
    read = kmh(RING, speed)
    wait = (np.arange(2500) - 1000) * 1e-3
    assert (np.diff(read[1000:]) <= 0.0).all()
    for k in (1100, 1200, 1400):
        assert read[k] == pytest.approx(PITCH_KMH / wait[k], rel=0.05)
    assert read[999] == pytest.approx(36.0, abs=0.02)
    assert (read[1000 + 505 :] == 0.0).all()


def test_standstill_is_zero():
    """A wheel that stands reads zero, from the lap's start."""
    assert not kmh(RING, np.zeros(100)).any()


def test_starting_needs_two_pulses():
    """From a standstill the reading stays zero until the second pulse."""
    speed = np.concatenate([np.zeros(1000), np.full(1000, 3.6)])  # then 1 m/s: 40 ms from tooth to tooth
    at = times(RING, speed)
    read = readings(np.arange(2000) * MS, at, 1e-9, 0.5) * PITCH_KMH
    first, second = at[np.isfinite(at)][:2]
    assert second - first == pytest.approx(0.04)
    assert not read[: int(second / 1e-3) + 1].any()
    assert read[int(second / 1e-3) + 1] == pytest.approx(3.6, rel=1e-6)


def test_restarting_needs_two_pulses():
    """The time over which the wheel stood is not taken for a period."""
    speed = np.concatenate([np.full(1000, 3.6), np.zeros(1000), np.full(1000, 3.6)])
    at = times(RING, speed)
    read = readings(np.arange(3000) * MS, at, 1e-9, 0.5) * PITCH_KMH
    first, second = at[at > 1.99][:2]
    assert read[999] > 3.0
    assert not read[1999 : int(second / 1e-3) + 1].any()
    assert first < 2.1


def test_held_between_pulses():
    """Between two pulses of a rolling wheel the reading does not move."""
    at = times(ROUGH, np.full(5000, 7.2))  # 20 ms from tooth to tooth
    at = at[at > 0.0]
    read = readings(np.arange(5000) * MS, at, 1e-9, 0.5) * PITCH_KMH
    for k in range(50, 60):
        period = at[k] - at[k - 1]
        held = read[int(at[k] / 1e-3) + 1 : int(min(at[k + 1], at[k] + period) / 1e-3)]
        assert len(held) > 10
        assert held == pytest.approx(PITCH_KMH / period, rel=1e-6)


def test_timer_tick():
    """The reading is the pitch over whole ticks."""
    part = Encoder(teeth=48, circumference_m=1.92, tick_s=1e-3)
    read = kmh(part, np.full(5000, 30.0))
    ticks = PITCH_KMH / np.unique(read) / 1e-3
    assert len(ticks) > 1
    assert ticks == pytest.approx(np.round(ticks), abs=1e-2)


def test_more_than_a_pulse_a_sample():
    """Above a pulse per sample the latest period counts, and none is lost."""
    at = times(RING, np.full(1000, 288.0))
    assert np.count_nonzero(at > 0.0) == pytest.approx(0.999 * 2000, abs=1)
    assert np.abs(kmh(RING, np.full(1000, 288.0)) - 288.0).max() <= 0.011


def test_pulses_do_not_depend_on_sampling():
    """A lap sampled at irregular instants gives the pulses of the same motion sampled regularly."""
    t = np.sort(np.random.default_rng(3).choice(np.arange(1, 4000), 1500, replace=False)) * MS // 4
    t = np.concatenate([[0], t, [1000 * MS]])
    edges = tooth_edges(ROUGH, np.random.default_rng(5))
    rate = lambda t_ns: 50.0 + 100e-9 * t_ns
    regular = np.arange(1001) * MS
    assert pulses(t, rate(t), edges, 3.2) == pytest.approx(
        pulses(regular, rate(regular), edges, 3.2), abs=1e-9
    )


def test_circumference():
    """A wrong circumference in the logger is an error of the slope."""
    part = Encoder(teeth=48, circumference_m=1.92, circumference=0.01, tick_s=1e-9)
    slopes = [kmh(part, np.full(3, 100.0), seed=seed)[0] / 100.0 - 1.0 for seed in range(400)]
    assert np.std(slopes) == pytest.approx(0.01, rel=0.15)


def test_backward_counts_forward():
    """A speed below zero gives the pulses of its magnitude."""
    assert np.abs(kmh(RING, np.full(100, -20.0)) - 20.0).max() <= 0.01
