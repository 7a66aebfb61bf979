import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from targets.errors import CalibrationError, TrainingError
from targets.halfcar import CORNER_HZ, HalfCar, fitted, pitch, rigid
from targets.narx.sequences import Sequences

INPUTS = ("fork_stroke_mm", "pitch_rate_dps", "speed_kmh")


def ride(samples: int, seed: int, rate_hz: float = 100.0) -> np.ndarray:
    """Fork stroke, pitch rate and speed (T, 3) that go up and down at some frequencies."""
    rng = np.random.Generator(np.random.PCG64(seed))
    t = np.arange(samples) / rate_hz
    tones = rng.uniform(0.05, 8.0, (2, 12))
    phases = rng.uniform(0.0, 6.28, (2, 12))
    fork, rate = np.sin(6.2832 * tones[..., None] * t + phases[..., None]).sum(axis=1)
    return np.stack([60.0 + 4.0 * fork, 5.0 * rate, 50.0 + t], axis=1)


def data(sensor: HalfCar, count: int = 3, samples: int = 2000) -> Sequences:
    """Rides of a motorcycle that is what `sensor` takes it for."""
    runs = []
    for k in range(count):
        u = ride(samples, k, sensor.rate_hz)
        runs.append((u, sensor.predict(dict(zip(INPUTS, u.T, strict=True)))))
    return Sequences(INPUTS, "rear_stroke_mm", tuple(runs), sensor.rate_hz)


def test_integral_of_the_pitch_rate():
    """Without a high-pass phi is the trapezoidal integral of the rate, from 0 (II.2)."""
    # 0, (0 + 90) / 2 * 0.5 s, ... in degrees
    assert np.degrees(pitch([0.0, 90.0, 90.0, 0.0], 0.0, 2.0)) == pytest.approx([0.0, 22.5, 67.5, 90.0])


def test_high_pass_by_hand():
    """One step of the high-passed integral is ((2 - w dt) phi + dt (rate + rate before)) / (2 + w dt)."""
    corner = 1.0 / (2.0 * np.pi)  # w = 1 per second, dt = 1 s
    phi = pitch(np.degrees([3.0, 3.0, 0.0]), corner, 1.0)
    assert phi == pytest.approx([0.0, 6.0 / 3.0, (2.0 + 3.0) / 3.0])


def test_drift_settles():
    """A constant rate b, a gyroscope's zero level, leads to a pitch of b / (2 pi corner) and no further."""
    phi = pitch(np.full(3000, 0.1), CORNER_HZ, 100.0)
    assert np.degrees(phi[-1]) == pytest.approx(0.1 / (2.0 * np.pi * CORNER_HZ))
    assert phi[-1] == pytest.approx(phi[-1000])


def test_fast_motion_passes():
    """Well above the corner the pitch is the integral: 4 Hz about a corner of 0.1 Hz lose no percent."""
    t = np.arange(2000) / 100.0
    rate = np.degrees(0.02 * 8.0 * np.pi * np.cos(8.0 * np.pi * t))
    phi = pitch(rate, 0.1, 100.0)[1000:]
    assert np.ptp(phi) == pytest.approx(0.04, rel=0.01)


def test_prediction_by_hand():
    """The rear stroke is fork_gain P_front + pitch_gain sin(phi) + offset (II.2)."""
    sensor = HalfCar(pitch_gain_mm=-1400.0, fork_gain=0.5, corner_hz=0.0, offset_mm=30.0, rate_hz=1.0)
    predicted = sensor.predict({"fork_stroke_mm": [60.0, 70.0], "pitch_rate_dps": [30.0, 30.0]})
    # phi = 0 and 30 degrees, whose sine is 0.5
    assert predicted == pytest.approx([0.5 * 60.0 + 30.0, 0.5 * 70.0 - 1400.0 * 0.5 + 30.0])


def test_braking_unloads_the_rear():
    """A nose that goes down while the fork stays takes stroke out of the rear."""
    sensor = rigid(data(HalfCar(-1000.0, 1.0, 0.7, 0.0)), interaxle_mm=1410.0)
    rest = sensor.predict({"fork_stroke_mm": [60.0] * 50, "pitch_rate_dps": [0.0] * 50})
    braking = sensor.predict({"fork_stroke_mm": [60.0] * 50, "pitch_rate_dps": [5.0] * 50})
    assert (braking[1:] < rest[1:]).all()


def test_rigid_ratios():
    """Strokes are converted to wheel travel and back by the sensors' ratios; the interaxle is in mm."""
    truth = HalfCar(-0.84 * 1410.0, 0.84 / 1.1, CORNER_HZ, 25.0)
    sensor = rigid(data(truth), interaxle_mm=1410.0, fork_ratio=1.1, rear_ratio=0.84)
    assert sensor.pitch_gain_mm == pytest.approx(truth.pitch_gain_mm)
    assert sensor.fork_gain == pytest.approx(truth.fork_gain)
    assert sensor.offset_mm == pytest.approx(25.0)


def test_rigid_offset_is_the_mean_of_what_counts():
    """The offset makes the mean error 0 over the training runs without their washout."""
    source = data(HalfCar(-300.0, 0.2, 2.0, 50.0))
    sensor = rigid(source, 1410.0, washout=150)
    errors = [sensor.predict(dict(zip(INPUTS, u.T, strict=True))) - y for u, y in source.runs]
    assert np.mean([e[150:] for e in errors]) == pytest.approx(0.0, abs=1e-9)
    assert abs(np.mean(errors)) > 0.01


@pytest.mark.parametrize("relative", [True, False])
@pytest.mark.parametrize("corner_hz", [0.05, 0.7, 3.0])
def test_fit_finds_the_truth(relative, corner_hz):
    """On rides of a motorcycle that is a half-car the fit finds its gains, corner and offset."""
    truth = HalfCar(-350.0, -0.12, corner_hz, 63.0)
    found = fitted(data(truth), relative=relative)
    assert found.corner_hz == pytest.approx(corner_hz, rel=1e-3)
    assert found.pitch_gain_mm == pytest.approx(-350.0, rel=1e-3)
    assert found.fork_gain == pytest.approx(-0.12, rel=1e-2)
    assert found.offset_mm == pytest.approx(63.0, rel=1e-3)


@pytest.mark.parametrize("relative", [True, False])
def test_no_neighbour_of_the_fit_is_better(relative):
    """Each parameter of the fit changed a little gives a larger squared error, on noisy rides as well."""
    rng = np.random.Generator(np.random.PCG64(5))
    clean = data(HalfCar(-350.0, 0.4, 0.5, 40.0))
    noisy = tuple((u, y + rng.normal(0.0, 3.0, len(y))) for u, y in clean.runs)
    source = Sequences(INPUTS, "rear_stroke_mm", noisy)
    best = fitted(source, relative=relative)

    def cost(sensor: HalfCar) -> float:
        total = 0.0
        for u, y in source.runs:
            error = sensor.predict(dict(zip(INPUTS, u.T, strict=True))) - y
            total += float(np.sum(((error / np.maximum(y, 1.0)) if relative else error)[100:] ** 2))
        return total

    names = ("pitch_gain_mm", "fork_gain", "corner_hz", "offset_mm")
    parameters = {name: getattr(best, name) for name in names}
    for name in names:
        for factor in (0.98, 1.02):
            assert cost(HalfCar(**(parameters | {name: factor * parameters[name]}))) > cost(best)


def test_runs_do_not_run_together():
    """A run's integral begins at 0 again: the fit is the same whatever the order of the runs."""
    source = data(HalfCar(-350.0, 0.4, 0.1, 40.0))
    turned = Sequences(INPUTS, "rear_stroke_mm", source.runs[::-1])
    assert fitted(turned).corner_hz == pytest.approx(fitted(source).corner_hz, rel=1e-6)


@given(st.floats(-20.0, 20.0), st.integers(2, 40), st.floats(0.0, 5.0))
def test_more_offset_is_more_stroke(added, samples, corner_hz):
    """The offset moves every predicted stroke by itself."""
    u = ride(samples, 1)
    channels = dict(zip(INPUTS, u.T, strict=True))
    low = HalfCar(-300.0, 0.5, corner_hz, 40.0).predict(channels)
    assert HalfCar(-300.0, 0.5, corner_hz, 40.0 + added).predict(channels) == pytest.approx(low + added)


@pytest.mark.parametrize(
    ("channels", "message"),
    [
        ({"fork_stroke_mm": [1.0]}, "no pitch_rate_dps"),
        ({"fork_stroke_mm": [1.0, 2.0], "pitch_rate_dps": [1.0]}, r"shape \(2,\)"),
        (
            {"fork_stroke_mm": [1.0, 2.0], "pitch_rate_dps": [1.0, np.nan]},
            "pitch_rate_dps is nan at sample 1",
        ),
    ],
)
def test_unfit_channels(channels, message):
    """Channels that are missing, of another length, or not finite are refused by name."""
    with pytest.raises(CalibrationError, match=message):
        HalfCar(-1.0, 1.0, 0.7, 0.0).predict(channels)


@pytest.mark.parametrize(
    "parameters", [(np.nan, 1.0, 0.7, 0.0), (1.0, 1.0, -0.1, 0.0), (1.0, 1.0, 0.7, 0.0, 0.0)]
)
def test_unfit_parameters(parameters):
    """A parameter that is not finite, a negative corner and a rate of 0 are refused."""
    with pytest.raises(CalibrationError, match="half-car"):
        HalfCar(*parameters)


def test_training_without_pitch_rate():
    """Training data without one of the two channels are refused by its name."""
    source = data(HalfCar(-300.0, 0.4, 0.7, 40.0))
    fork_only = Sequences(INPUTS[:1], "rear_stroke_mm", tuple((u[:, :1], y) for u, y in source.runs))
    for make in (fitted, lambda rides: rigid(rides, 1410.0)):
        with pytest.raises(TrainingError, match="no pitch_rate_dps"):
            make(fork_only)


def test_training_on_a_short_run():
    """A run no longer than the washout is refused with its number."""
    with pytest.raises(TrainingError, match="sequence 0 has 80 samples"):
        fitted(data(HalfCar(-300.0, 0.4, 0.7, 40.0), samples=80))


def test_no_geometry():
    """An interaxle of 0 and a ratio that is not positive are refused."""
    source = data(HalfCar(-300.0, 0.4, 0.7, 40.0))
    for geometry in ((0.0, 1.0, 1.0), (1410.0, 0.0, 1.0), (1410.0, 1.0, -1.0)):
        with pytest.raises(TrainingError, match="interaxle"):
            rigid(source, *geometry)
