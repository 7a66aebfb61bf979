"""The road as numbers: heights and grades on an even grid along the route.

Belongs here: the grid's constants, shared by all that makes a road, and the finished road. Never: how a
height comes about.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

STEP_M = 0.02  # a fifth of a tyre's contact length
LONGEST_WAVE_M = 100.0  # ISO 8608 speaks of 0.011 cycles/m and above; longer waves are the grade


class Road(NamedTuple):
    """Heights and grades every STEP_M from where the rear wheel starts; the route begins LEAD_IN_M later."""

    height_m: NDArray[np.float64]
    grade: NDArray[np.float64]

    def grade_at(self, x_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Rise per run at places in metres from where the rear wheel starts."""
        return np.interp(x_m / STEP_M, np.arange(len(self.grade)), self.grade)
