import numpy as np
import pytest

from bench.errors import RouteError
from bench.plant.road.iso8608 import density, synthesise
from bench.plant.road.spectrum import fitted, measured


def test_bands_are_the_standards():
    """Octaves to 0.0312 cycles/m, third-octaves to 0.25, twelfth-octaves from 0.2806 to above 2.83."""
    n = measured(np.random.default_rng(0).standard_normal(200_000), 0.02).n_per_m
    assert n[n < 0.04] == pytest.approx([0.00195, 0.0039, 0.0078, 0.0156, 0.0312], rel=0.01)
    thirds = n[(n > 0.04) & (n < 0.26)]
    assert (len(thirds), thirds[0], thirds[-1]) == (8, pytest.approx(0.0496, rel=1e-3), 0.25)
    twelfths = n[n > 0.26]
    assert twelfths[0] == pytest.approx(0.2806, rel=1e-3)
    assert twelfths[1:] / twelfths[:-1] == pytest.approx(2 ** (1 / 12))
    assert np.any(np.abs(n - 2.8284) < 1e-4)


def test_a_sine_has_its_power_in_its_band():
    """The power of a sine of 1 mm, half its amplitude squared, is found in the band it lies in."""
    x = np.arange(50_000) * 0.02
    n, g = measured(1e-3 * np.sin(2 * np.pi * 0.125 * x), 0.02)
    k = int(np.argmax(g))
    assert n[k] == pytest.approx(0.125)
    assert g[k] * n[k] * (2 ** (1 / 6) - 2 ** (-1 / 6)) == pytest.approx(0.5e-6, rel=1e-3)


@pytest.mark.parametrize("waviness", [1.5, 2.0, 3.0])
def test_the_fit_finds_what_was_synthesised(waviness):
    """Level and waviness of a synthetic road of 3 km are found again within 25 % and 0.1."""
    line = fitted(measured(synthesise(100e-6, waviness, 150_000, 0.02, np.random.default_rng(1)), 0.02))
    assert line.level_m3 == pytest.approx(100e-6, rel=0.25)
    assert line.waviness == pytest.approx(waviness, abs=0.1)


def test_the_fit_of_a_straight_line_is_the_line():
    """A spectrum that is a straight line is found exactly."""
    n = 2.0 ** np.arange(-6, 2)
    line = fitted(type(measured(np.arange(200.0) % 7, 0.02))(n, density(n, 3e-5, 2.3)))
    assert line == pytest.approx((3e-5, 2.3))


def test_a_slope_has_no_spectrum():
    """A hill that rises evenly has no roughness, and the fit says so."""
    with pytest.raises(RouteError, match="no roughness"):
        fitted(measured(np.zeros(10_000), 0.02))
    assert measured(np.arange(10_000) * 0.001, 0.02).density_m3.max() < 1e-20


def test_short_profiles_lose_the_long_bands():
    """A profile of 10 m has no band below the one that holds its own length."""
    n = measured(np.random.default_rng(0).standard_normal(500), 0.02).n_per_m
    assert n[0] > 0.1


@pytest.mark.parametrize(
    ("height", "says"),
    [(np.zeros(99), "99 samples has no spectrum"), (np.full(200, np.nan), "no finite numbers")],
)
def test_refuses_what_has_no_spectrum(height, says):
    """Too few samples, or samples that are no numbers, are refused."""
    with pytest.raises(RouteError, match=says):
        measured(height, 0.02)
