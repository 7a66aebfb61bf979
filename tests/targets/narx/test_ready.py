from dataclasses import replace

import numpy as np
import pytest

from targets.narx.ready import Ready
from targets.narx.settings import Settings

SETTINGS = Settings(neurons=2, delays=3, washout=10)


def test_relative_weights(rides):
    """Relative errors are weighted by the inverse stroke, or by that of the floor where it is less."""
    data = rides()
    ready = Ready(data, replace(SETTINGS, floor=30.0))
    weight = ready.segments(None).weight[:, 10:]
    y = np.stack([y for _, y in ready.training])[:, 10:]
    assert y.min() < 30.0
    product = weight * np.maximum(y, 30.0)
    assert np.allclose(product, product[0, 0])


def test_relative_weights_are_about_one(rides):
    """Relative errors stay as large as plain ones, so that the decay means the same for both."""
    weight = Ready(rides(), SETTINGS).segments(None).weight[:, 10:]
    assert np.mean(weight) == pytest.approx(1.0, rel=0.05)


def test_plain_weights(rides):
    """Plain errors all weigh 1."""
    weight = Ready(rides(), replace(SETTINGS, relative=False)).segments(None).weight
    assert np.array_equal(np.unique(weight), [0.0, 1.0])


def test_held_out_runs_are_spread(rides):
    """A third of six runs held out are the second and the fifth, and none of them trains."""
    data = rides()
    ready = Ready(data, replace(SETTINGS, held_out=1 / 3))
    held = [y.tobytes() for _, y in ready.held_out]
    assert held == [data.runs[k][1].tobytes() for k in (1, 4)]
    assert len(ready.training) == 4
    assert not {y.tobytes() for _, y in ready.training} & set(held)


def test_one_run_of_two_trains(rides):
    """However large the share, one run is left to train on."""
    ready = Ready(rides(2, 300), replace(SETTINGS, held_out=0.99))
    assert (len(ready.training), len(ready.held_out)) == (1, 1)


def test_segments_are_normalised(rides):
    """Segments hold inputs and output as shares of their ranges, from -1 to 1."""
    ready = Ready(rides(), SETTINGS)
    segments = ready.segments(100)
    u, y = ready.training[0]
    assert segments.measured.shape == (5 * 7, 100)
    assert np.allclose(segments.v[0, 3:, 1], u[:100, 1] / 100.0 - 1.0)
    assert np.allclose(segments.measured[1], y[100:200] / 55.0 - 1.0)
    assert np.allclose(segments.start[0], ready.initial / 55.0 - 1.0)
