"""A small nonlinear system to learn, and networks with random weights."""

from collections.abc import Callable

import numpy as np
import pytest

from targets.narx.network import Narx
from targets.narx.sequences import Sequences

RANGES = {"fork_stroke_mm": (0.0, 150.0), "speed_kmh": (0.0, 200.0), "rear_stroke_mm": (0.0, 110.0)}


def swing(samples: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Inputs (T, 2) and output (T,) of a sprung mass that stiffens, pushed by the fork, pressed by speed."""
    rng = np.random.Generator(np.random.PCG64(seed))
    push, speed = np.zeros(samples), np.zeros(samples)
    for t in range(1, samples):
        push[t] = 0.9 * push[t - 1] + rng.normal(0.0, 6.0)
        speed[t] = 0.99 * speed[t - 1] + rng.normal(0.0, 4.0)
    u = np.stack([70.0 + push, 100.0 + speed], axis=1)
    place, y = np.zeros(2), np.empty(samples)
    for t in range(samples):
        y[t] = 40.0 + place[0]
        force = 0.3 * push[t] + 0.02 * speed[t] - 0.25 * place[0] - 0.0005 * place[0] ** 3
        place = np.array([place[0] + 0.5 * place[1], 0.5 * place[1] + force])
    return u, y


@pytest.fixture(scope="session")
def rides() -> Callable[..., Sequences]:
    """Make a data set: `rides(count, samples, first_seed)`."""

    def make(count: int = 6, samples: int = 700, first_seed: int = 0) -> Sequences:
        runs = tuple(swing(samples, first_seed + k) for k in range(count))
        return Sequences(("fork_stroke_mm", "speed_kmh"), "rear_stroke_mm", runs)

    return make


@pytest.fixture
def network() -> Callable[..., Narx]:
    """Make a network of two inputs with random weights: `network(seed, neurons, delays)`."""

    def make(seed: int = 0, neurons: int = 5, delays: int = 3, size: float = 0.5) -> Narx:
        rng = np.random.Generator(np.random.PCG64(seed))
        return Narx(
            inputs=("fork_stroke_mm", "speed_kmh"),
            output="rear_stroke_mm",
            delays=delays,
            input_ranges=(RANGES["fork_stroke_mm"], RANGES["speed_kmh"]),
            output_range=RANGES["rear_stroke_mm"],
            W1=rng.normal(0.0, size, (neurons, 3 * delays)),
            b1=rng.normal(0.0, size, neurons),
            w2=rng.normal(0.0, size, neurons),
            b2=rng.normal(0.0, 0.1),
            initial_mm=30.0,
        )

    return make
