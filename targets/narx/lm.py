"""Levenberg-Marquardt on an objective's Gauss-Newton matrix (section III.3).

Belongs here: the damped step, its acceptance, and when to stop. Never: a network, data.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

MU_LEAST, MU_MOST = 1e-9, 1e6
"""Bounds of the damping; below the first, float32 rounding in the matrix exceeds it."""
MU_FACTOR = 10.0
"""By which the damping falls after a success and grows after a failure."""


class Problem(Protocol):
    """What is minimised; see `objective.Objective`."""

    def cost(self, theta: Floats) -> float:
        """Return the objective at theta (P,)."""

    def normal(self, theta: Floats) -> tuple[Any, Any]:
        """Return Gauss-Newton matrix (P, P) and half gradient (P,), float64 torch tensors."""


@dataclass(frozen=True)
class Iterate:
    """Where an optimisation stands after an iteration; judge: what `validate` said (lower is better)."""

    iteration: int
    cost: float
    judge: float
    mu: float


@dataclass(frozen=True)
class Outcome:
    """The best theta by `validate`, the iterate it was found at, and how many iterations were made."""

    theta: Floats
    judge: float
    iterations: int
    interrupted: bool


def minimise(
    problem: Problem,
    theta: Floats,
    validate: Callable[[Floats], float],
    iterations: int,
    patience: int,
    report: Callable[[Iterate], None],
) -> Outcome:
    """Minimise `problem` from theta (P,), keeping the iterate that `validate` likes best.

    Stops after `iterations`, after `patience` of them without a better judgement, when no step lowers the
    cost any more, or on KeyboardInterrupt, keeping the best so far.
    """
    mu = 1e-3
    best, best_judge, best_at = theta, validate(theta), 0
    done = 0
    try:
        cost = problem.cost(theta)
        for k in range(1, iterations + 1):
            found = _step(problem, theta, cost, mu)
            if found is None:
                break
            theta, cost, mu = found
            done = k
            judge = validate(theta)
            report(Iterate(k, cost, judge, mu))
            if judge < best_judge:
                best, best_judge, best_at = theta, judge, k
            elif k - best_at >= patience:
                break
    except KeyboardInterrupt:
        return Outcome(best, best_judge, done, True)
    return Outcome(best, best_judge, done, False)


def _step(problem: Problem, theta: Floats, cost: float, mu: float) -> tuple[Floats, float, float] | None:
    """One iteration: (J'J + mu I) step = -J'e, with the damping that lowers the cost most.

    The matrix costs far more than a solve and a cost, so after a success less damping is tried at once.
    Returns theta, cost, and the damping to go on from, or None if no damping lowers the cost.
    """
    H, g = problem.normal(theta)
    found: tuple[Floats, float, float] | None = None
    rising = False
    while MU_LEAST <= mu <= MU_MOST:
        step = _solve(H, g, mu)
        tried = problem.cost(theta - step) if step is not None else np.inf
        if tried < (found[1] if found else cost):  # False for NaN
            found = (theta - step, tried, mu)
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
    """Solve (H + mu I) step = g by Cholesky; None where rounding left the matrix not positive definite."""
    import torch

    damped = H.clone()
    damped.diagonal().add_(mu)
    factor, failed = torch.linalg.cholesky_ex(damped)
    if int(failed):
        return None
    step: Floats = torch.cholesky_solve(g[:, None], factor)[:, 0].cpu().numpy()
    return step
