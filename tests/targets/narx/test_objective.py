import numpy as np
import pytest

from targets.narx import objective as module
from targets.narx.objective import Objective, cut

N, D = 2, 3
P = N * (2 * D + 2) + 1


def runs(lengths=(40, 25)):
    rng = np.random.Generator(np.random.PCG64(5))
    return [(rng.uniform(-1, 1, (n, 1)), rng.uniform(-1, 1, n), rng.uniform(0.5, 2.0, n)) for n in lengths]


def objective(closed=True, single=False, length=16, decay=0.01) -> Objective:
    return Objective(cut(runs(), D, 0.1, 4, length), N, closed, decay, "cpu", single)


def point(seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).normal(0.0, 0.5, P)


def test_segments_carry_on_where_the_last_one_ended():
    """A later segment starts from what was measured before it, the first from the start value."""
    (u, y, _), _ = data = runs()
    segments = cut(data, D, 0.1, 4, 16)
    assert segments.measured.shape == (3 + 2, 16)
    assert np.array_equal(segments.v[1, :, 0], u[16 - D : 32, 0])
    assert np.array_equal(segments.start[1], y[[15, 14, 13]])
    assert np.array_equal(segments.v[0, :D, 0], np.full(D, u[0, 0]))
    assert np.array_equal(segments.start[0], np.full(D, 0.1))


def test_only_measured_samples_count():
    """Washout and what fills a last segment up have weight 0, every other sample its own."""
    data = runs()
    segments = cut(data, D, 0.1, 4, 16)
    assert np.array_equal(segments.weight[0], np.concatenate([np.zeros(4), data[0][2][4:16]]))
    assert np.array_equal(segments.weight[2], np.concatenate([data[0][2][32:], np.zeros(8)]))


@pytest.mark.parametrize("closed", [True, False])
def test_gradient(closed):
    """The half gradient is half the central difference of the cost."""
    problem = objective(closed)
    theta, h = point(), 1e-5
    _, g = problem.normal(theta)
    for p in range(P):
        step = np.eye(P)[p] * h
        slope = (problem.cost(theta + step) - problem.cost(theta - step)) / (2 * h)
        assert float(g[p]) == pytest.approx(slope / 2, rel=1e-5, abs=1e-8)


@pytest.mark.parametrize("closed", [True, False])
def test_matrix(closed):
    """The Gauss-Newton matrix is J'J of the mean squared error, J by differences, plus the decay."""
    problem = objective(closed)
    theta, h = point(), 1e-5
    columns = [
        (problem.errors(theta + s) - problem.errors(theta - s)).ravel() / (2 * h) for s in np.eye(P) * h
    ]
    J = np.stack(columns, axis=1) / np.sqrt(np.sum(problem.segments.weight**2))
    H, _ = problem.normal(theta)
    assert np.allclose(H.numpy(), J.T @ J + 0.01 * np.eye(P), rtol=1e-5, atol=1e-8)


def test_panels(monkeypatch):
    """Multiplied in panels of columns, of which the last is narrower, the matrix is the same."""
    problem = objective(closed=True)
    at_once = problem.normal(point())
    monkeypatch.setattr(module, "PANEL", 5)
    for a, b in zip(at_once, problem.normal(point()), strict=True):
        assert np.allclose(a, b, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("closed", [True, False])
def test_single_precision_and_long_blocks(closed):
    """Blocks in float32, over segments longer than a block, give the matrix of float64 within rounding."""
    data = runs((1300, 700))
    segments = cut(data, D, 0.1, 4, 1300)
    exact, single = (Objective(segments, N, closed, 0.0, "cpu", s).normal(point()) for s in (False, True))
    for a, b in zip(exact, single, strict=True):
        assert float((a - b).abs().max()) < 1e-5 * float(a.abs().max())


@pytest.mark.parametrize("closed", [True, False])
def test_repeats(closed):
    """The same theta gives the same bytes of matrix and gradient."""
    problem = objective(closed, single=True)
    first, second = (problem.normal(point()) for _ in range(2))
    assert all(a.numpy().tobytes() == b.numpy().tobytes() for a, b in zip(first, second, strict=True))
