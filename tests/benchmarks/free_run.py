"""What a step of the soft sensor costs in free run: compiled, in numpy, in torch.

python -m tests.benchmarks.free_run [STEPS]
"""

import sys
import time

import numpy as np

from targets.calibration import load
from targets.ecus import DEFAULT_CALIBRATION
from targets.narx.network import Narx
from targets.narx.prepare import normalised, physical
from targets.narx.reference import parallel


def in_numpy(narx: Narx, u: np.ndarray) -> np.ndarray:
    """The loop one would write first: a matrix product and a tanh a step."""
    d = narx.delays
    v = np.stack([normalised(u[:, j], span) for j, span in enumerate(narx.input_ranges)], axis=1)
    v = np.concatenate([np.repeat(v[:1], d, axis=0), v])
    past = np.full(d, float(normalised(narx.initial_mm, narx.output_range)))
    y = np.empty(len(u))
    for t in range(len(u)):
        x = np.concatenate([v[t : t + d][::-1].T.ravel(), past])
        y[t] = narx.w2 @ np.tanh(narx.W1 @ x + narx.b1) + narx.b2
        past = np.concatenate([y[t : t + 1], past[:-1]])
    return physical(y, narx.output_range)


def main() -> None:
    """Print nanoseconds a step, the median of five runs each, and how far apart the results are."""
    import torch

    torch.set_num_threads(1)
    steps = int(sys.argv[1]) if len(sys.argv) > 1 else 30_000
    narx = load(DEFAULT_CALIBRATION).network
    rng = np.random.default_rng(0)
    walk = np.cumsum(rng.standard_normal((steps, 3)), axis=0)
    u = np.array([60.0, 0.0, 70.0]) + walk / np.abs(walk).max(axis=0) * np.array([40.0, 40.0, 60.0])
    ways = {
        "compiled": narx.free_run,
        "numpy loop": lambda u: in_numpy(narx, u),
        "torch": lambda u: parallel(narx, u),
    }
    results, fastest = {}, 0.0
    for name, run in ways.items():
        run(u[:100])
        times = []
        for _ in range(5):
            begun = time.perf_counter()
            results[name] = run(u)
            times.append(time.perf_counter() - begun)
        ns = 1e9 * sorted(times)[2] / steps
        fastest = fastest or ns
        apart = np.abs(results[name] - results["compiled"]).max()
        print(f"{name:12} {ns:9.0f} ns a step   {ns / fastest:6.1f} x   within {apart:.1e} mm")


if __name__ == "__main__":
    main()
