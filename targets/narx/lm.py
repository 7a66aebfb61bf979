"""Levenberg-Marquardt on an objective's Gauss-Newton matrix (section III.3).

Belongs here: the damped step and its acceptance. Never: a network, data, a decision when to stop.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

MU_START = 1e-3
"""The damping of the first step, beside a Gauss-Newton matrix whose diagonal is scaled to 1."""
MU_LEAST, MU_MOST = 1e-9, 1e6
"""Bounds of the damping; below the first, float32 rounding in the matrix exceeds it."""
MU_FACTOR = 3.0
"""By which the damping falls after a success and grows after a failure."""


class Problem(Protocol):
    """What is minimised; see `objective.Objective`."""

    def cost(self, theta: Floats) -> float:
        """Return the objective at theta (P,)."""

    def normal(self, theta: Floats) -> tuple[Any, Any]:
        """Return Gauss-Newton matrix (P, P) and half gradient (P,), float64 torch tensors."""


class Iterate(NamedTuple):
    """Where the descent stands: theta (P,), its cost, and the damping to go on from."""

    theta: Floats
    cost: float
    mu: float


def descend(problem: Problem, theta: Floats) -> Iterator[Iterate]:
    """Yield iterate after iterate from theta (P,) on, until no step lowers the cost any more."""
    at = Iterate(theta, problem.cost(theta), MU_START)
    while (found := _step(problem, at)) is not None:
        at = found
        yield found


def _step(problem: Problem, at: Iterate) -> Iterate | None:
    """One iteration: (J'J + mu D) step = J'e, with the damping that lowers the cost most.

    The matrix costs far more than a solve and a cost, so after a success less damping is tried at once.
    """
    theta, least, mu = at
    H, g = problem.normal(theta)
    found: Iterate | None = None
    rising = False
    while MU_LEAST <= mu <= MU_MOST:
        step = _solve(H, g, mu)
        cost = problem.cost(theta - step) if step is not None else np.inf
        if step is not None and cost < least:  # False for NaN
            found, least = Iterate(theta - step, cost, mu), cost
            if rising:
                break
            mu /= MU_FACTOR
        elif found:
            break
        else:
            rising = True
            mu *= MU_FACTOR
    return found


def _solve(H: Any, g: Any, mu: float) -> Floats | None:
    """Solve (H + mu diag H) step = g by Cholesky; None where rounding left no positive definite matrix."""
    import torch

    damped = H.clone()
    damped.diagonal().mul_(1.0 + mu).add_(1e-12)  # a weight without effect has no diagonal
    factor, failed = torch.linalg.cholesky_ex(damped)
    if int(failed):
        return None
    step: Floats = torch.cholesky_solve(g[:, None], factor)[:, 0].cpu().numpy()
    return step
