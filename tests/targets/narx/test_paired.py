import numpy as np
import pytest
import torch

from targets.narx import paired
from targets.narx.jacobian import unpacked
from targets.narx.objective import Segments, cut
from targets.narx.paired import Paired
from targets.narx.recursion import forward, packed

N, D, INPUTS = 4, 3, 2
P = N * ((INPUTS + 1) * D + 2) + 1


def segments(lengths=(700, 430), horizon=300) -> Segments:
    rng = np.random.default_rng(5)
    runs = [
        (rng.uniform(-1, 1, (n, INPUTS)), rng.uniform(-1, 1, n), rng.uniform(0.5, 2.0, n)) for n in lengths
    ]
    return cut(runs, D, 0.1, 4, horizon)


def point() -> np.ndarray:
    return np.random.default_rng(1).normal(0.0, 0.5, P)


def made_ready(data, dtype=torch.float64) -> Paired:
    return Paired(data.v, data.measured, data.weight, data.start, N, "cpu", dtype)


def gram(data, dtype=torch.float64, threads=1) -> np.ndarray:
    return made_ready(data, dtype).gram(point(), threads).numpy()


def explicit(data) -> np.ndarray:
    """[J, e]'[J, e] of a Jacobian written down row by row."""
    W1, b1, w2, b2 = unpacked(point(), N)
    rows = []
    for v, measured, weight, start in zip(data.v, data.measured, data.weight, data.start, strict=True):
        y = [*start[::-1], *measured]
        for t, w in enumerate(weight):
            x = np.array([past[D + t - k] for past in (*v.T, y) for k in range(1, D + 1)])
            a = np.tanh(W1 @ x + b1)
            delta = w2 * (1.0 - a**2)
            error = w2 @ a + b2 - measured[t]
            rows.append(w * np.concatenate([np.outer(delta, x).ravel(), delta, a, [1.0, error]]))
    return np.transpose(rows) @ rows


def test_errors():
    """Errors are those of the network on measured outputs, segment by segment, where there is a weight."""
    data = segments()
    W1, b1, w2, b2 = unpacked(point(), N)
    y = np.empty_like(data.measured)
    for k, v in enumerate(data.v):
        forward(*packed(W1, b1, w2), b2, v, data.start[k], False, data.measured[k], y[k])
    expected = (data.weight * (y - data.measured))[data.weight > 0.0]
    found = made_ready(data).errors(point(), 2).ravel()
    assert np.allclose(found[: expected.size], expected, rtol=0.0, atol=1e-12)
    assert not np.any(found[expected.size :])


def test_explicit_jacobian():
    """Sums of pairs, over several blocks, are the products of the explicit Jacobian and its errors."""
    data = segments()
    assert np.count_nonzero(data.weight) > 2 * paired.ROWS
    expected = explicit(data)
    assert np.allclose(gram(data), expected, rtol=1e-11, atol=1e-11)


def test_single_precision():
    """Pairs in float32 lose no more than some units of the seventh digit of what their weights cost alone."""
    data = segments()
    expected = explicit(data)
    size = np.sqrt(np.diag(expected))
    assert np.max(np.abs(gram(data, torch.float32) - expected) / np.outer(size, size)) < 1e-6


def test_symmetric():
    """The matrix is its own mirror image bit for bit, in float32 too."""
    found = gram(segments(), torch.float32)
    assert np.array_equal(found, found.T)


@pytest.mark.parametrize("lengths", [(1,), (paired.ROWS + 4,), (paired.ROWS + 5,)])
def test_blocks_that_are_not_full(lengths):
    """Less than a block, a whole one and one sample more are all summed to the last sample."""
    data = segments((*lengths, 40), horizon=2000)
    assert np.allclose(gram(data), explicit(data), rtol=1e-11, atol=1e-11)


def test_threads():
    """More threads than blocks, and a number that leaves some without work, give the same sums."""
    data = segments()
    alone = gram(data)
    for threads in (2, 7):
        assert np.allclose(gram(data, threads=threads), alone, rtol=1e-12, atol=1e-12)


def test_samples_without_weight():
    """A stroke that only samples without weight see changes nothing, however large it is."""
    data = segments()
    before = gram(data)
    assert not np.any(data.weight[0, : D + 1])
    data.measured[0, 0] = 1e300
    assert np.array_equal(gram(data), before)
