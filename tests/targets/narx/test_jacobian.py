import numpy as np

from targets.narx.jacobian import rows, unpacked
from targets.narx.recursion import forward, packed

N, D, L = 3, 7, 60
P = N * (3 * D + 2) + 1


def case():
    rng = np.random.Generator(np.random.PCG64(8))
    theta = rng.normal(0.0, 0.4, P)
    v = rng.uniform(-1.0, 1.0, (D + L, 2))
    return theta, v, rng.uniform(-1.0, 1.0, L), rng.uniform(0.5, 2.0, L), rng.uniform(-1.0, 1.0, D)


def output(theta, v, measured, start):
    W1, b1, w2, b2 = unpacked(theta, N)
    y = np.empty(L)
    forward(*packed(W1, b1, w2), b2, v, start, True, measured, y)
    return y


def jacobian(dtype=np.float64, blocks=(L,)):
    theta, v, measured, weight, start = case()
    W1, b1, w2, b2 = unpacked(theta, N)
    state = start.copy(), np.zeros((D, P), dtype)
    pieces, begin = [], 0
    for size in blocks:
        out = np.empty((size, P + 1), dtype)
        rows(*packed(W1, b1, w2), b2, N, v, measured, weight, begin, *state, out)
        pieces.append(out)
        begin += size
    return np.concatenate(pieces)


def test_finite_differences():
    """Every column of the Jacobian is the central difference of the closed loop's output by that weight."""
    theta, v, measured, weight, start = case()
    J = jacobian()
    h = 1e-5
    for p in range(P):
        step = np.zeros(P)
        step[p] = h
        up, down = (output(theta + sign * step, v, measured, start) for sign in (1, -1))
        assert np.allclose(J[:, p], weight * (up - down) / (2 * h), rtol=1e-6, atol=1e-8)


def test_error_column():
    """The last column is the weighted error."""
    theta, v, measured, weight, start = case()
    expected = weight * (output(theta, v, measured, start) - measured)
    assert np.allclose(jacobian()[:, P], expected, rtol=0.0, atol=1e-12)


def test_blocks():
    """Block by block, the state carried on, gives the same rows as at once."""
    assert np.array_equal(jacobian(blocks=(7, 30, 1, 22)), jacobian())


def test_past_the_end():
    """Rows past a segment's end are 0."""
    J = jacobian(blocks=(50, 20))
    assert np.any(J[L - 1])
    assert not np.any(J[L:])


def test_single_precision():
    """Sensitivities in float32 agree with float64 to a few units of the sixth digit."""
    exact = jacobian()
    assert np.allclose(jacobian(np.float32), exact, rtol=0.0, atol=1e-5 * np.max(np.abs(exact)))
