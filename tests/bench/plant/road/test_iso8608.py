from itertools import pairwise

import numpy as np
import pytest

from bench.plant.road.iso8608 import LEVELS_M3, class_of, density, limits, synthesise


def rng(seed=0):
    return np.random.default_rng(seed)


def test_classes_are_four_times_as_rough_each():
    """The geometric means of the classes A to H go from 16e-6 to 262144e-6 m3 by factors of four."""
    assert list(LEVELS_M3) == list("ABCDEFGH")
    assert list(LEVELS_M3.values()) == pytest.approx([k * 1e-6 for k in 16 * 4 ** np.arange(8)])


def test_classes_meet():
    """Each class ends where the next begins, a factor of two from its mean."""
    bounds = [limits(mean) for mean in LEVELS_M3.values()]
    assert bounds[0] == pytest.approx((8e-6, 32e-6))
    for (_, upper), (lower, _) in pairwise(bounds):
        assert upper == pytest.approx(lower)


@pytest.mark.parametrize(
    ("level", "letter"), [(1e-9, "A"), (31e-6, "A"), (33e-6, "B"), (256e-6, "C"), (0.13, "G"), (9.0, "H")]
)
def test_a_level_has_a_class(level, letter):
    """A level lies in the class whose limits hold it; A is open below and H above."""
    assert class_of(level) == letter


def test_density_falls_by_the_waviness():
    """A decade above n0 the density is lower by ten to the waviness."""
    found = density(np.array([0.1, 1.0]), 64e-6, 2.5)
    assert found == pytest.approx([64e-6, 64e-6 * 10**-2.5])


def test_synthesis_begins_and_ends_at_zero():
    """A stretch starts at zero and its next sample would be zero again, to within one sample's slope."""
    height = synthesise(64e-6, 2.0, 5000, 0.02, rng())
    assert height[0] == 0.0
    assert abs(height[-1]) < 5 * np.abs(np.diff(height)).std()


def test_nothing_is_longer_than_the_longest_wave():
    """A stretch of 400 m holds no wave longer than 100 m."""
    spectrum = np.abs(np.fft.rfft(synthesise(64e-6, 2.0, 20_000, 0.02, rng())))
    assert spectrum[1:4].max() < 1e-9 * spectrum[4:].max()


def test_variance_is_what_the_law_integrates_to():
    """Over many draws the variance is the integral of the density over the waves that fit in (Parseval)."""
    heights = np.stack([synthesise(64e-6, 2.0, 5000, 0.02, rng(k)) for k in range(300)])
    n = np.arange(1, 2500) / 100.0
    expected = np.sum(density(n, 64e-6, 2.0)) * 0.01
    assert heights.var(axis=1).mean() == pytest.approx(expected, rel=0.1)


@pytest.mark.parametrize("count", [1, 2, 3, 50])
def test_stretches_of_a_few_samples_have_heights(count):
    """Down to one sample a stretch has as many finite heights as asked."""
    height = synthesise(64e-6, 2.0, count, 0.02, rng())
    assert height.shape == (count,)
    assert np.all(np.isfinite(height))
