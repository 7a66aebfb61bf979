"""The fault kinds: what each one does to a sensor's codes, and the parameters it takes.

Adding a kind is one function and one row of KINDS. A function gets the whole lap's healthy codes and the
fault's samples, and returns the faulty codes of those samples. Never here: parsing, times, other sensors.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.sensors.transducers import Transducer

Value = float | str


@dataclass(frozen=True)
class Number:
    """A numeric parameter: its default and the closed interval it must lie in."""

    default: float
    low: float
    high: float


@dataclass(frozen=True)
class Choice:
    """A parameter that is one of a few words; the first is the default."""

    options: tuple[str, ...]

    @property
    def default(self) -> str:
        """The word taken when none is given."""
        return self.options[0]


class Acting(NamedTuple):
    """A fault at work: it acts on samples [start, stop) of `codes` int32 (samples,), at `t_ns` int64."""

    codes: NDArray[np.int32]
    t_ns: NDArray[np.int64]
    start: int
    stop: int
    transducer: Transducer
    params: Mapping[str, Value]

    def constant(self, code: int) -> NDArray[np.int32]:
        """`code` for as long as the fault lasts, int32 (stop - start,)."""
        return np.full(self.stop - self.start, code, dtype=np.int32)


@dataclass(frozen=True)
class Kind:
    """One row of KINDS: what the fault does, and the parameters it knows."""

    act: Callable[[Acting], NDArray[np.int32]]
    params: Mapping[str, Number | Choice]
    about: str


def _open(fault: Acting) -> NDArray[np.int32]:
    return fault.constant(fault.transducer.code_max)


def _short(fault: Acting) -> NDArray[np.int32]:
    to_ground = fault.params["to"] == "gnd"
    return fault.constant(fault.transducer.code_min if to_ground else fault.transducer.code_max)


def _hold(fault: Acting) -> NDArray[np.int32]:
    # a fault from the first sample on has no earlier value to hold: it keeps that first one
    return fault.constant(int(fault.codes[max(fault.start - 1, 0)]))


def _uncalibration(fault: Acting) -> NDArray[np.int32]:
    healthy = fault.codes[fault.start : fault.stop]
    return fault.transducer.saturate(healthy * np.float64(fault.params["gain"]))[0]


KINDS: dict[str, Kind] = {
    "open": Kind(_open, {}, "open circuit: the full scale (section V.2.1)"),
    "short": Kind(
        _short,
        {"to": Choice(("gnd", "batt"))},
        "short circuit: to ground the minimum (section V.2.1), to battery the full scale",
    ),
    "hold": Kind(_hold, {}, "the last value before the fault (section V.2.2)"),
    "uncalibration": Kind(
        _uncalibration,
        {"gain": Number(1.1, 0.0, 10.0)},
        "losing calibration: another slope of the input/output curve (section V.2.3)",
    ),
}
"""Fault kind -> what it does; the thesis's four of section V.2."""
