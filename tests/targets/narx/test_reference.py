"""The torch form of the network: the compiled recursion's other half of the proof."""

import numpy as np
import pytest

from targets.narx.reference import module, parallel, series_parallel

rng = np.random.default_rng(5)
U = np.stack([70 + 20 * rng.standard_normal(300), 100 + 30 * rng.standard_normal(300)], axis=1)


def test_parallel_form_is_the_compiled_free_run(network):
    """Torch's free run and the compiled one agree to 1e-9 mm over 300 samples."""
    narx = network(seed=2, neurons=5, delays=3)
    assert parallel(narx, U) == pytest.approx(narx.free_run(U), abs=1e-9)


def test_series_parallel_form_is_the_compiled_one_step(network):
    """Fed with measured outputs torch predicts what the compiled one-step form does."""
    narx = network(seed=3, neurons=4, delays=4)
    y = 50 + 10 * np.sin(np.arange(300) / 9)
    assert series_parallel(narx, U, y) == pytest.approx(narx.one_step(U, y), abs=1e-9)


def test_the_two_forms_are_one_network(network):
    """Fed back with its own free run the series-parallel form gives that free run (Figure III.5)."""
    narx = network(seed=4, size=0.2)
    own = parallel(narx, U)
    assert series_parallel(narx, U, own) == pytest.approx(own, abs=1e-9)


def test_the_module_holds_every_weight(network):
    """The torch module has the network's weights in double precision, and nothing else."""
    narx = network()
    count = sum(parameter.numel() for parameter in module(narx).parameters())
    assert count == narx.W1.size + narx.b1.size + narx.w2.size + 1
    assert all(str(parameter.dtype) == "torch.float64" for parameter in module(narx).parameters())
