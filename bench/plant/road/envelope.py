"""What a tyre makes of a road: the height its contact patch feels.

Belongs here: enveloping. Never: the tyre's forces.

FIDELITY: the tyre averages over its contact length, so that it reaches into holes it would bridge, and
meets an edge no sooner than its patch does.
"""

import numpy as np
from numpy.typing import NDArray

from bench.plant.road.grid import STEP_M

CONTACT_M = 0.08  # averaged over twice: a tyre envelops what is shorter than its contact patch


def envelope(height_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """What the wheel's centre follows: the moving average over the contact length, taken twice, centred."""
    width = round(CONTACT_M / STEP_M)
    height = height_m
    for _ in range(2):
        total = np.cumsum(np.concatenate([np.zeros(1), height, np.full(width, height[-1])]))
        height = (total[width:] - total[:-width])[: len(height)] / width
    # Each pass looks (width - 1) / 2 samples ahead: shift back by both together.
    return np.concatenate([np.full(width - 1, height[0]), height[: len(height) - width + 1]])
