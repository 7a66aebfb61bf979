"""Measures of riding, each on a signal whose measure is known."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from bench.errors import LapError
from bench.laps import describe
from bench.laps.describe import GRID_HZ, STROKES, delay, even_pieces, motion, pooled_delay, pooled_spectrum
from bench.laps.lap import Lap
from tests.conftest import SHARED

FORK, REAR = STROKES


def lap(rate_hz=1000.0, seconds=40.0, source="lap", **channels):
    """A lap of even steps; each channel is a function of time, or an array."""
    t = np.arange(round(seconds * rate_hz)) / rate_hz
    values = {name: f(t) if callable(f) else np.asarray(f) for name, f in channels.items()}
    return Lap(np.rint(t * 1e9).astype(np.int64), values, source)


def sine(hz, amplitude, mean=50.0):
    return lambda t: mean + amplitude * np.sin(2 * np.pi * hz * t)


def noise(samples, seed=0):
    return np.random.default_rng(seed).standard_normal(samples)


def road(seconds, rate_hz=1000.0, seed=0):
    """A rough line, band-limited to where strokes move."""
    from scipy.signal import butter, sosfilt

    rough = noise(round(seconds * rate_hz), seed)
    return 50 + 30 * sosfilt(butter(2, (2, 20), "band", fs=rate_hz, output="sos"), rough)


def test_speed_of_a_sine():
    """A stroke of 20 mm at 2 Hz is fastest at 2 pi f A, its other percentiles are a sine's."""
    (piece,) = even_pieces([lap(fork_stroke_mm=sine(2.0, 20.0))])
    found = motion([piece], FORK)
    top = 2 * np.pi * 2.0 * 20.0
    assert found.fastest == pytest.approx(top, rel=2e-3)
    # |cos| is below sin(p pi / 2) for the share p of the time
    assert_allclose(found.percentiles, top * np.sin(np.array([0.5, 0.9, 0.99, 0.999]) * np.pi / 2), rtol=2e-3)
    assert found.compression_p99 == pytest.approx(found.rebound_p99, rel=1e-3)


def test_range_and_spread_of_a_sine():
    """A sine of 20 mm about 50 mm goes from 30 to 70 mm, its standard deviation is 20 / sqrt(2)."""
    found = motion(even_pieces([lap(fork_stroke_mm=sine(2.0, 20.0))]), FORK)
    assert (found.low_mm, found.high_mm) == pytest.approx((30.0, 70.0), abs=1e-3)
    assert found.std_mm == pytest.approx(20 / np.sqrt(2), rel=1e-6)


def test_wheel_hop_passes_the_low_pass():
    """Of a wheel hop at 15 Hz the low pass of 50 Hz takes less than 2 %."""
    (piece,) = even_pieces([lap(fork_stroke_mm=sine(15.0, 5.0))])
    middle = np.abs(describe.stroke_speed(piece, FORK)[1000:-1000]).max()
    assert 0.98 < middle / (2 * np.pi * 15 * 5) <= 1.0


def test_asymmetry():
    """A stroke compressed in a quarter of the time that it takes to come back is four times as fast there."""
    saw = lambda t: np.interp(t % 1.0, (0.0, 0.2, 1.0), (0.0, 40.0, 0.0))
    found = motion(even_pieces([lap(fork_stroke_mm=saw)]), FORK)
    assert found.compression_p99 == pytest.approx(200.0, rel=0.1)
    assert found.rebound_p99 == pytest.approx(50.0, rel=0.15)


def test_shares_of_a_steady_speed():
    """Classes count absolute speeds, each from its lower edge on; the last is open."""
    shares = describe.shares(np.array([-49.9, 50.0, -399.0, 400.0, 5000.0, 0.0, 0.0, 0.0]))
    assert shares.tolist() == [0.5, 0.125, 0, 0, 0.125, 0.125, 0, 0, 0, 0.125]


def test_share_under_the_limit():
    """A stroke that moves at 300, then at 500 mm/s, then rests is under 400 mm/s for all but the second."""
    saw = lambda t: np.interp(t % 1.0, (0.0, 0.5, 0.8, 1.0), (0.0, 150.0, 0.0, 0.0))
    found = motion(even_pieces([lap(fork_stroke_mm=saw)]), FORK)
    assert found.under_limit == pytest.approx(0.7, abs=0.02)
    assert found.classes.sum() == pytest.approx(1.0)
    assert found.histogram.sum() == pytest.approx(1.0)


def test_band_of_a_sine():
    """All power of a sine, A^2 / 2, lies in the band of its frequency, on any time base."""
    for rate_hz in (100.0, 333.0, 1000.0):
        found = motion(even_pieces([lap(rate_hz, fork_stroke_mm=sine(7.0, 4.0))]), FORK)
        where = describe.BANDS_HZ.index(5.0)
        assert found.bands[where] == pytest.approx(8.0, rel=0.01)
        assert np.delete(found.bands, where).sum() < 0.01


def test_density_of_white_noise():
    """White noise of variance 1 at 1 kHz has the density 1 / 500 Hz everywhere."""
    found = pooled_spectrum(even_pieces([lap(seconds=400, fork_stroke_mm=noise(400_000))]), FORK)
    assert found[GRID_HZ > 0.5].mean() == pytest.approx(1 / 500, rel=0.01)
    assert_allclose(describe.band_powers(found)[-2:], [10 / 500, 30 / 500], rtol=0.1)


def test_no_density_beyond_half_the_rate():
    """At 60 Hz nothing is known beyond 30 Hz: neither the band up to 50 Hz nor a share of all power."""
    found = motion(even_pieces([lap(60.0, fork_stroke_mm=sine(2.0, 4.0))]), FORK)
    assert np.isfinite(found.bands[:-1]).all()
    assert np.isnan(found.bands[-1])
    assert np.isnan(found.speed_in_range)


def test_shares_of_derivatives():
    """Of two equally fast sines the slower has half of the speed, a hundredth of the acceleration."""
    both = lambda t: sine(2.0, 10.0)(t) + sine(20.0, 1.0)(t)
    found = motion(even_pieces([lap(fork_stroke_mm=both)]), FORK)
    assert found.speed_in_range == pytest.approx(0.5, rel=0.01)
    assert found.acceleration_in_range == pytest.approx(1 / 101, rel=0.02)


def test_resolution():
    """A sensor's code is found again; a constant has none."""
    values = np.round(np.linspace(0, 100, 5000) / 0.3) * 0.3
    assert describe.resolution(values) == pytest.approx(0.3)
    assert np.isnan(describe.resolution(np.ones(100)))


@pytest.mark.parametrize("rate_hz", [100.0, 1000.0])
@pytest.mark.parametrize("late_s", [0.0, 0.0634, 0.4])
def test_delay_of_a_copy(rate_hz, late_s):
    """A copy that is late by a known time is found late by that time, between the samples too."""
    rough = road(62, 10_000.0)
    t, k = np.arange(len(rough)) / 10_000, np.arange(round(60 * rate_hz)) / rate_hz
    channels = {FORK: np.interp(k + 1, t, rough), REAR: 0.6 * np.interp(k + 1 - late_s, t, rough)}
    found = delay(lap(rate_hz, 60.0, **channels, speed_kmh=np.full(len(k), 72.0)))
    assert (found.windows, found.of) == (11, 11)
    assert_allclose((found.low_s, found.median_s, found.high_s), late_s, atol=0.1 / rate_hz)
    assert found.base_m == pytest.approx(20.0 * found.median_s)


def test_delay_behind_a_common_motion():
    """A heave that moves both ends at once, stronger than the road, does not hide the delay."""
    rough, heave = road(62), 100 * np.sin(2 * np.pi * 0.9 * np.arange(62_000) / 1000)
    found = delay(
        lap(seconds=60, **{FORK: (rough + heave)[1000:-1000], REAR: (rough + heave * 1.0)[1000:-1000]})
    )
    late = delay(
        lap(seconds=60, **{FORK: rough[1000:-1000] + heave[:60_000], REAR: rough[900:-1100] + heave[:60_000]})
    )
    assert found.median_s == pytest.approx(0.0, abs=1e-4)
    assert late.median_s == pytest.approx(0.1, abs=5e-4)


def test_no_delay_between_strangers():
    """Two strokes that have nothing to do with each other have no delay: no window counts."""
    found = delay(lap(seconds=60, **{FORK: road(60, seed=1), REAR: road(60, seed=2)}))
    assert (found.windows, found.of) == (0, 11)
    assert np.isnan([found.median_s, found.low_s, found.high_s, found.base_m]).all()


def test_no_base_without_speed():
    """Without the channel speed a delay is no length."""
    rough = road(30)
    found = delay(lap(seconds=29, **{FORK: rough[1000:], REAR: rough[950:-50]}))
    assert found.median_s == pytest.approx(0.05, abs=1e-3)
    assert np.isnan(found.base_m)


def test_standing_still():
    """Of a machine at rest there is nothing to say, and nothing is said: speeds 0, shares and delay NaN."""
    pieces = even_pieces([lap(**{FORK: lambda t: 0 * t + 40, REAR: lambda t: 0 * t + 50})])
    found = motion(pieces, FORK)
    assert found.fastest == pytest.approx(0.0, abs=1e-9)
    assert found.under_limit == 1.0
    assert pooled_delay(pieces).windows == 0


def test_gap_is_left_out():
    """A gap makes two pieces, and no speed is read across it."""
    t_ns = np.concatenate([np.arange(20_000), np.arange(30_000, 50_000)]) * 1_000_000
    values = np.where(t_ns < 25e9, 10.0, 90.0)
    pieces = even_pieces([Lap(t_ns, {FORK: values})])
    assert [len(piece.t_ns) for piece in pieces] == [20_000, 20_000]
    assert motion(pieces, FORK).fastest == pytest.approx(0.0, abs=1e-9)


def test_jitter_is_interpolated():
    """Samples taken at uneven times are brought onto an even time base before anything is measured."""
    rng = np.random.default_rng(3)
    t = np.arange(40_000) / 1000 + rng.uniform(-2e-4, 2e-4, 40_000)
    t[0] = 0.0
    uneven = Lap(np.rint(t * 1e9).astype(np.int64), {FORK: sine(2.0, 20.0)(t)})
    (piece,) = even_pieces([uneven])
    assert np.ptp(np.diff(piece.t_ns)) <= 1
    assert motion([piece], FORK).fastest == pytest.approx(2 * np.pi * 2 * 20, rel=0.01)


def test_uneven_lap_is_no_piece():
    """A lap with a gap, taken as it is, is refused with the place of the gap."""
    t_ns = np.concatenate([np.arange(100), np.arange(200, 300)]) * 1_000_000
    with pytest.raises(
        LapError, match=r"ride: a step of 101 ms after 0\.099 s where .* not an even time base"
    ):
        describe.rate_hz(Lap(t_ns, {FORK: np.zeros(200)}, "ride"))


def test_nothing_left():
    """A lap without 64 samples in a row is refused by name."""
    t_ns = np.concatenate([np.arange(50) + 1000 * k for k in range(9)]) * 1_000_000
    with pytest.raises(LapError, match="ride: nowhere 64 samples without a gap"):
        even_pieces([Lap(t_ns, {FORK: np.zeros(450)}, "ride")])


def test_pooled_laps():
    """Laps pooled are measured as one: the widest range, shares by time, windows added up."""
    calm, wild = (lap(fork_stroke_mm=sine(2.0, a), source=str(a)) for a in (2.0, 30.0))
    found = motion(even_pieces([calm, wild]), FORK)
    assert (found.low_mm, found.high_mm) == pytest.approx((20.0, 80.0), abs=0.01)
    alone = [motion(even_pieces([each]), FORK) for each in (calm, wild)]
    assert_allclose(found.classes, (alone[0].classes + alone[1].classes) / 2)
    assert_allclose(found.bands, (alone[0].bands + alone[1].bands) / 2)


def test_rates_are_not_pooled():
    """Laps of different rates are refused in one line that names both."""
    with pytest.raises(LapError, match="slow: sampled at 100 Hz, fast at 1000 Hz: not to be pooled"):
        even_pieces(
            [lap(fork_stroke_mm=np.sin, source="fast"), lap(100.0, fork_stroke_mm=np.sin, source="slow")]
        )


def test_missing_stroke():
    """A lap without a stroke is refused by the stroke's name."""
    with pytest.raises(LapError, match="missing rear_stroke_mm, needed by the speed of a stroke"):
        delay(lap(fork_stroke_mm=np.sin))


def test_delay_of_a_recorded_ride():
    """On a recorded mountain bike ride the rear follows at a fifth of a second: 1.25 m at some 22 km/h."""
    from bench.laps.channel_map import load_map
    from bench.laps.files import read_lap
    from bench.laps.sufni import MAPS

    path = SHARED / "data" / "sufni-mtb-sst" / "test_2023-05-07.SST"
    if not path.exists():
        pytest.skip(f"no recording {path.name}: it is not part of the repository")
    found = delay(read_lap(path, load_map(MAPS / "clash2022.toml")))
    assert 0.19 < found.median_s < 0.22
    assert found.windows >= 10
