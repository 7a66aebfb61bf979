"""Characteristics that are not straight."""

import numpy as np
import pytest

from bench.sensors.curves import Curve, bend, smooth_curve, texture

LINE = Curve(0.0, 10.0, np.array([0.0, 1.0, -1.0]))


@pytest.mark.parametrize(
    ("x", "bent"), [(0.0, 0.0), (2.5, 3.0), (5.0, 6.0), (7.5, 7.5), (10.0, 9.0), (-3.0, -3.0), (99.0, 98.0)]
)
def test_bend(x, bent):
    """A signal is bent by the curve, straight between its points and constant beyond its ends."""
    assert bend(LINE, np.array([x]))[0] == pytest.approx(bent)


def test_largest_deviation_is_uniform():
    """Over many specimens the largest deviation is uniform up to the limit."""
    worst = [np.abs(smooth_curve(np.random.default_rng(k), 2.0, 0.0, 1.0).table).max() for k in range(800)]
    assert max(worst) <= 2.0
    assert np.mean(worst) == pytest.approx(1.0, abs=4 * 2.0 / np.sqrt(12 * 800))


def test_zeros():
    """A curve is zero at its ends, and in the middle where that is asked for."""
    ends = smooth_curve(np.random.default_rng(0), 1.0, -5.0, 5.0).table
    middle = smooth_curve(np.random.default_rng(0), 1.0, -5.0, 5.0, through_middle=True).table
    assert ends[[0, -1]] == pytest.approx(0.0, abs=1e-12)
    assert abs(ends[512]) > 1e-3
    assert middle[[0, 512, -1]] == pytest.approx(0.0, abs=1e-12)


def test_texture():
    """Texture is independent from point to point and uniform within its peak to peak."""
    grains = texture(np.random.default_rng(0), Curve(0.0, 1.0, np.zeros(10_000)), 0.4).table
    assert np.abs(grains).max() <= 0.2
    assert grains.std() == pytest.approx(0.4 / np.sqrt(12), rel=0.03)
    assert abs(np.corrcoef(grains[1:], grains[:-1])[0, 1]) < 0.04
