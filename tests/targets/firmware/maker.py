"""A decision maker compiled into a shared library, called from this process; mutants of it, too."""

import ctypes
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.targets.firmware.sanitized import VERDICT


class Maker:
    """The library at `path`; `decide` answers as that of the driver does."""

    def __init__(self, path: Path) -> None:
        self._decide = ctypes.CDLL(str(path)).decide

    def decide(self, image: bytes, predicted: NDArray[Any], measured: NDArray[Any]) -> NDArray[Any]:
        """The verdicts on a ride of strokes in mm, float32 (T,)."""
        p, m = np.ascontiguousarray(predicted, "<f4"), np.ascontiguousarray(measured, "<f4")
        out = np.zeros(len(p), VERDICT)
        self._decide(image, len(p), *(array.ctypes.data_as(ctypes.c_void_p) for array in (p, m, out)))
        return out
