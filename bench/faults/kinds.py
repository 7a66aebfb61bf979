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
    """A numeric parameter: its default and the closed interval it must lie in.

    extra: written only where it is not the default, for what most faults of the kind do without.
    """

    default: float
    low: float
    high: float
    extra: bool = False


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
    """One row of KINDS: what the fault does, the parameters it knows, and what a detector calls it.

    called: the name of IFD_STATUS.kind that is right for the fault with these parameters, None if there is
    none.
    """

    act: Callable[[Acting], NDArray[np.int32]]
    params: Mapping[str, Number | Choice]
    about: str
    called: Callable[[Mapping[str, Value]], str | None]


def _open(fault: Acting) -> NDArray[np.int32]:
    return fault.constant(fault.transducer.code_max)


def _short(fault: Acting) -> NDArray[np.int32]:
    to_ground = fault.params["to"] == "gnd"
    return fault.constant(fault.transducer.code_min if to_ground else fault.transducer.code_max)


def _hold(fault: Acting) -> NDArray[np.int32]:
    # a fault from the first sample on has no earlier value to hold: it keeps that first one
    held = fault.constant(int(fault.codes[max(fault.start - 1, 0)]))
    sigma = float(fault.params["noise"])
    if not sigma:
        return held
    # what the wires behind a stuck slider still pick up; the same fault of the same lap draws the same
    seed = (len(held), int(held[0]) if len(held) else 0)
    draw = np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed)))
    noise = np.asarray(draw.normal(0.0, sigma, len(held)), dtype=np.float64)
    return fault.transducer.saturate(held + noise)[0]


def _uncalibration(fault: Acting) -> NDArray[np.int32]:
    healthy = fault.codes[fault.start : fault.stop]
    return fault.transducer.saturate(healthy * np.float64(fault.params["gain"]))[0]


def _offset(fault: Acting) -> NDArray[np.int32]:
    healthy = fault.codes[fault.start : fault.stop]
    codes = np.float64(fault.params["by"]) / fault.transducer.per_code
    return fault.transducer.saturate(healthy + codes)[0]


def _as(name: str) -> Callable[[Mapping[str, Value]], str | None]:
    return lambda _: name


KINDS: dict[str, Kind] = {
    "open": Kind(_open, {}, "open circuit: the full scale (section V.2.1)", _as("open")),
    "short": Kind(
        _short,
        {"to": Choice(("gnd", "batt"))},
        "short circuit: to ground the minimum (section V.2.1), to battery the full scale",
        # at the full scale nobody can tell a short to battery from an open circuit
        lambda params: "short" if params["to"] == "gnd" else "open",
    ),
    "hold": Kind(
        _hold,
        {"noise": Number(0.0, 0.0, 1000.0, extra=True)},
        "the last value before the fault (section V.2.2), under noise of so many codes (sigma)",
        _as("hold"),
    ),
    "uncalibration": Kind(
        _uncalibration,
        {"gain": Number(1.1, 0.0, 10.0)},
        "losing calibration: another slope of the input/output curve (section V.2.3)",
        _as("uncalibration"),
    ),
    "offset": Kind(
        _offset,
        {"by": Number(5.0, -1000.0, 1000.0)},
        "losing calibration: an offset, in the unit of the sensor's channel",
        _as("uncalibration"),
    ),
}
"""Fault kind -> what it does; the thesis's four of section V.2, and an offset."""
