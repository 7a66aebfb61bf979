from itertools import islice, pairwise

import numpy as np
import torch

from targets.narx.lm import descend


class Valley:
    """Rosenbrock's valley as a sum of squares: errors 10 (b - a^2) and 1 - a, the least at (1, 1)."""

    def errors(self, theta):
        return np.array([10.0 * (theta[1] - theta[0] ** 2), 1.0 - theta[0]])

    def cost(self, theta):
        return float(np.sum(self.errors(theta) ** 2))

    def normal(self, theta):
        J = np.array([[-20.0 * theta[0], 10.0], [-1.0, 0.0]])
        return torch.from_numpy(J.T @ J), torch.from_numpy(J.T @ self.errors(theta))


def test_finds_the_least():
    """The descent ends in the least point of a curved valley, and ends by itself."""
    *_, last = descend(Valley(), np.array([-1.2, 1.0]))
    assert np.allclose(last.theta, [1.0, 1.0], atol=1e-6)


def test_never_rises():
    """No iterate costs more than the one before."""
    costs = [iterate.cost for iterate in islice(descend(Valley(), np.array([-1.2, 1.0])), 30)]
    assert len(costs) > 3
    assert all(later < earlier for earlier, later in pairwise(costs))


def test_a_matrix_that_is_not_positive_definite():
    """A matrix spoiled by rounding is damped until it can be factored, never used as it is."""

    class Spoiled(Valley):
        def normal(self, theta):
            H, g = super().normal(theta)
            H[0, 1] = H[1, 0] = 1.05 * torch.sqrt(H[0, 0] * H[1, 1])
            return H, g

    start = np.array([-1.2, 1.0])
    first = next(descend(Spoiled(), start))
    assert first.cost < Valley().cost(start)
    assert first.mu > 0.04
