"""Seconds per Levenberg-Marquardt iteration of ours and of others: the same data, one process, one thread.

    python -m tests.benchmarks.lm [--samples 36000 360000] [--repeat 3]

N = 15, d = 10, three inputs and the fed-back output: 631 weights, all from the same starting point. An
iteration is a whole one: network, Jacobian, normal matrix, solving, the cost of what was tried. Everyone
takes a turn in every round, the first of which is not counted; medians are printed.

- ours, in float32 blocks, float64 for network and cost: series-parallel; parallel, the loop closed for 10 s.
- torch-levenberg-marquardt (`pip install torch-levenberg-marquardt`), series-parallel, in float32, its
  default, with what was fastest here: Cholesky instead of its default QR, and Jacobians by vmap for slices of
  SLICE samples, its own option, which also keeps 360,000 samples in memory.
- scipy.optimize.least_squares, series-parallel, in float64, with the analytic Jacobian, dense: the
  Levenberg-Marquardt of MINPACK ('lm') and the default ('trf'), from one Jacobian to the next.
- DSYRK of the same J: N x P^2 multiplications and additions, in float64, and nothing else.

Those that are not installed, or whose Jacobians do not fit in memory, are left out and said to be.
"""

import argparse
import os

for name in ("OMP", "MKL", "OPENBLAS", "NUMBA"):
    os.environ[f"{name}_NUM_THREADS"] = "1"

import time  # noqa: E402  # libraries read the numbers of threads when they are imported
from collections.abc import Callable  # noqa: E402
from contextlib import suppress  # noqa: E402
from statistics import median  # noqa: E402

import numpy as np  # noqa: E402
import torch  # noqa: E402
from scipy.linalg.blas import dsyrk  # noqa: E402
from scipy.optimize import least_squares  # noqa: E402

from targets.narx.jacobian import unpacked  # noqa: E402
from targets.narx.lm import descend  # noqa: E402
from targets.narx.objective import Objective, Segments, cut  # noqa: E402
from targets.narx.recursion import forward, packed  # noqa: E402

NEURONS, DELAYS, INPUTS = 15, 10, 3
N_X = (INPUTS + 1) * DELAYS
WEIGHTS = NEURONS * (N_X + 2) + 1
HORIZON = 1000
SLICE = 4000
GIB = 2**30
SLOW_S = 20.0
"""Whose iteration takes longer has one turn, which counts."""
JACOBIANS = {"lm": 3, "trf": 2}
"""The Jacobian with which a second iteration begins; least_squares tries one before it calls MINPACK."""
COPIES = {"DSYRK": 1, "scipy": 5}
"""How many dense Jacobians are in memory at once."""
OURS, OURS_PARALLEL = "ours, series-parallel", "ours, parallel"
TORCH_LM, DSYRK = "torch-levenberg-marquardt", "DSYRK"

Turn = Callable[[], float]
"""Does one iteration and returns its seconds."""


def weights(seed: int, size: float = 1.0) -> np.ndarray:
    """Random theta, drawn as training draws it."""
    rng = np.random.default_rng(seed)
    W1 = rng.uniform(-1.0, 1.0, NEURONS * N_X) * size * np.sqrt(0.75 / N_X)
    return np.concatenate([W1, rng.uniform(-1.0, 1.0, NEURONS), rng.uniform(-0.3, 0.3, NEURONS), [0.0]])


def ride(samples: int) -> Segments:
    """Return what a random network answers to three filtered noises, measured with noise, as one run."""
    rng = np.random.default_rng(1)
    u = np.zeros((DELAYS + samples, INPUTS))
    for t in range(1, len(u)):
        u[t] = 0.9 * u[t - 1] + rng.normal(0.0, 0.2, INPUTS)
    W1, b1, w2, b2 = unpacked(weights(2), NEURONS)
    y = np.empty(samples)
    forward(*packed(W1, b1, w2), b2, u, np.zeros(DELAYS), True, y, y)
    y += rng.normal(0.0, 0.01, samples)
    return cut([(u[DELAYS:], y, np.ones(samples))], DELAYS, 0.0, 0, HORIZON)


def regressors(segments: Segments) -> np.ndarray:
    """What the network sees at each sample in the series-parallel form, (samples, N_X)."""
    past_y = np.concatenate([segments.start[:, ::-1], segments.measured], axis=1)
    past = np.concatenate([segments.v, past_y[:, :, None]], axis=2)
    windows = np.lib.stride_tricks.sliding_window_view(past[:, :-1], DELAYS, axis=1)[..., ::-1]
    return windows.reshape(-1, N_X)


def ours(segments: Segments, closed: bool) -> Turn:
    iterates = descend(Objective(segments, NEURONS, closed, 1e-7, "cpu", True), weights(3))
    return lambda: timed(lambda: next(iterates))


def torch_lm(X: np.ndarray, y: np.ndarray) -> Turn:
    from torch_levenberg_marquardt.loss import MSELoss
    from torch_levenberg_marquardt.training import LevenbergMarquardtModule

    model = torch.nn.Sequential(torch.nn.Linear(N_X, NEURONS), torch.nn.Tanh(), torch.nn.Linear(NEURONS, 1))
    W1, b1, w2, b2 = unpacked(weights(3), NEURONS)
    with torch.no_grad():
        for mine, start in zip(model.parameters(), (W1, b1, w2[None], [b2]), strict=True):
            mine.copy_(torch.tensor(np.asarray(start)))
    peer = LevenbergMarquardtModule(model, MSELoss(), solve_method="cholesky", max_batch_size=SLICE)
    inputs, targets = (torch.tensor(values, dtype=torch.float32) for values in (X, y[:, None]))
    return lambda: timed(lambda: peer.training_step(inputs, targets))


def jacobian(X: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """J (samples, P), dense, in float64."""
    W1, b1, w2, _ = unpacked(theta, NEURONS)
    a = np.tanh(X @ W1.T + b1)
    delta = w2 * (1.0 - a * a)
    J = np.empty((len(X), WEIGHTS))
    by_neuron = J[:, : NEURONS * N_X].reshape(len(X), NEURONS, N_X)
    np.multiply(delta[:, :, None], X[:, None, :], out=by_neuron)
    J[:, NEURONS * N_X : -1 - NEURONS] = delta
    J[:, -1 - NEURONS : -1] = a
    J[:, -1] = 1.0
    return J


def scipy_lm(X: np.ndarray, y: np.ndarray, method: str) -> Turn:
    def error(theta: np.ndarray) -> np.ndarray:
        W1, b1, w2, b2 = unpacked(theta, NEURONS)
        return np.tanh(X @ W1.T + b1) @ w2 + b2 - y

    def turn() -> float:
        begun: list[float] = []

        def jac(theta: np.ndarray) -> np.ndarray:
            begun.append(time.perf_counter())
            if len(begun) == JACOBIANS[method]:
                raise Enough
            return jacobian(X, theta)

        with suppress(Enough):
            least_squares(error, weights(3), jac, method=method)
        return begun[-1] - begun[-2]

    return turn


class Enough(Exception):
    """Ends a least_squares that has done its iteration."""


def plain_dsyrk(X: np.ndarray) -> Turn:
    J = jacobian(X, weights(3))
    return lambda: timed(lambda: dsyrk(1.0, J.T))  # the transpose of rows is what Fortran calls columns


def timed(work: Callable[[], object]) -> float:
    """Seconds that `work` takes."""
    begun = time.perf_counter()
    work()
    return time.perf_counter() - begun


def compare(samples: int, repeat: int) -> None:
    """Print the table for so many samples, and what ours is of each of the others."""
    segments = ride(samples)
    X, y = regressors(segments)[:samples], segments.measured.ravel()[:samples]
    size = 8 * samples * WEIGHTS
    memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    print(
        f"{samples} samples, {WEIGHTS} weights; a dense float64 Jacobian is {size / GIB:.2f} GiB", flush=True
    )
    contestants = {
        OURS: lambda: ours(segments, False),
        OURS_PARALLEL: lambda: ours(segments, True),
        TORCH_LM: lambda: torch_lm(X, y),
        DSYRK: lambda: plain_dsyrk(X),
        "scipy least_squares 'trf'": lambda: scipy_lm(X, y, "trf"),
        "scipy least_squares 'lm'": lambda: scipy_lm(X, y, "lm"),
    }
    turns: dict[str, Turn] = {}
    for who, prepare in contestants.items():
        if COPIES.get(who.split()[0], 0) * size > memory:
            print(
                f"  {who:28} left out: {COPIES[who.split()[0]]} Jacobians are more than this machine's memory"
            )
            continue
        try:
            turns[who] = prepare()
        except ImportError as error:
            print(f"  {who:28} absent: {error}")
    seconds: dict[str, list[float]] = {who: [] for who in turns}
    for turn in range(1 + repeat):
        for who, iterate in turns.items():
            if turn and seconds[who][0] > SLOW_S:
                continue
            seconds[who].append(iterate())
    medians = {who: median(each[1:] or each) for who, each in seconds.items()}
    print(f"  {'':28} {'s':>9} {'us a sample':>12} {'ours, s.-p., of it':>19} {'ours, par., of it':>18}")
    for who, one in medians.items():
        print(
            f"  {who:28} {one:9.3f} {1e6 * one / samples:12.2f} "
            f"{medians[OURS] / one:19.3f} {medians[OURS_PARALLEL] / one:18.3f}"
        )


def main() -> None:
    """Read the command line and compare at each size."""
    parser = argparse.ArgumentParser(description="Seconds per Levenberg-Marquardt iteration.")
    parser.add_argument("--samples", type=int, nargs="+", default=[36_000, 360_000])
    parser.add_argument("--repeat", type=int, default=3)
    given = parser.parse_args()
    torch.set_num_threads(1)
    for samples in given.samples:
        compare(samples, given.repeat)


if __name__ == "__main__":
    main()
