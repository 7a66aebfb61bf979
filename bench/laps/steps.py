"""The steps of one clock: what may be wrong with them, and the words that say so.

Belongs here: one time base, the samples on it, and the rules. Each is against the nominal step, the median
of the steps forward:

    repeated     a step of zero: the same sample again, or other values under a time already taken
    set back     a step below zero
    set forward  a step of more than 10 s and more than 100 nominal ones: no logger loses samples for so long
                 and goes on in the same lap; its clock was set, or it was stopped and started again
    gap          any other step of more than 1.5 nominal ones
    jitter       what is left differs from the nominal step by more than 1 % of it

Never: a format, several clocks at once, nor a judgement on values; a value that holds is a fault kind.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from bench.errors import LapError

GAP = 1.5
JITTER = 0.01
JUMP_NS, JUMP_STEPS = 10_000_000_000, 100
EPOCH_NS = 50 * 86_400_000_000_000
"""A clock that begins later counts from some year, not from a start-up."""
_FARTHEST_NS = 1 << 62  # differences of what lies within fit int64

Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Samples:
    """Samples on one clock. t_ns: int64 (samples,), at least one; values: float64 (samples,) each.

    number: int64 (samples,), their places in the file, from 0. label: opens each line about them.
    """

    t_ns: NDArray[np.int64]
    values: Mapping[str, NDArray[np.float64]]
    number: NDArray[np.int64]
    label: str = ""

    @cached_property
    def steps(self) -> NDArray[np.int64]:
        """From each sample to the next, ns (samples - 1,)."""
        return np.diff(self.t_ns)

    @cached_property
    def nominal_ns(self) -> float:
        """The median of the steps forward; 0 if there is none."""
        forward = self.steps[self.steps > 0]
        return float(np.median(forward)) if forward.size else 0.0

    @cached_property
    def jump(self) -> Mask:
        """The steps by which the clock was set forward."""
        return self.steps > max(JUMP_NS, JUMP_STEPS * self.nominal_ns)

    @cached_property
    def gap(self) -> Mask:
        """The steps in which samples are missing."""
        return (self.steps > GAP * self.nominal_ns) & ~self.jump

    def same(self) -> Mask:
        """Whether each sample but the first has the values of the one before."""
        same = np.ones(len(self.t_ns) - 1, dtype=bool)
        for values in self.values.values():
            same &= values[1:] == values[:-1]
        return same

    def at(self, k: int) -> str:
        """Where sample `k` is: time since the first, and place in the file."""
        return f"{(self.t_ns[k] - self.t_ns[0]) / 1e9:.9g} s, sample {self.number[k]}"


def check_span(samples: Samples, where: str) -> None:
    """Raise LapError for times further apart than int64 nanoseconds can subtract."""
    low, high = int(samples.t_ns.min()), int(samples.t_ns.max())
    if high - low >= _FARTHEST_NS:
        raise LapError(f"{where}: {samples.label}time from {in_s(low)} to {in_s(high)} is no lap's")


def refuse(samples: Samples, where: str) -> None:
    """Raise LapError for time that repeats or goes back, naming the sample and both times."""
    stuck = np.flatnonzero(samples.t_ns[1:] <= samples.t_ns[:-1])
    if not stuck.size:
        return
    k = int(stuck[0])
    before, after = samples.t_ns[k], samples.t_ns[k + 1]
    kind = "set back"
    if before == after:
        kind = "the same sample again" if samples.same()[k] else "other values at the same time"
    more = f", {stuck.size} such in all" if stuck.size > 1 else ""
    raise LapError(
        f"{where}: {samples.label}time does not increase at sample {samples.number[k + 1]}: "
        f"{before / 1e9:.9g} s then {after / 1e9:.9g} s ({kind}{more}); --repair mends it"
    )


def judge(samples: Samples) -> list[str]:
    """Lines about clock jumps forward, gaps and jitter of a time that increases."""
    return [*jump_line(samples, samples.jump), *gap_line(samples, samples.gap), *jitter_line(samples)]


def jump_line(samples: Samples, mask: Mask) -> list[str]:
    """One line about the jumps in `mask`, all one way, naming the widest; none if there are none."""
    if not mask.any():
        return []
    by = samples.steps - round(samples.nominal_ns)
    k = widest(np.abs(by), mask)
    way = "forward" if by[k] > 0 else "back"
    return [
        f"{samples.label}clock set {way} by {in_s(abs(by[k]))} after {samples.at(k)} "
        f"({many(mask.sum(), 'jump')})"
    ]


def gap_line(samples: Samples, mask: Mask) -> list[str]:
    """One line about the gaps in `mask`, naming the widest; none if there are none."""
    if not mask.any():
        return []
    k = widest(samples.steps, mask)
    missing = float(np.sum(samples.steps[mask] - samples.nominal_ns))
    return [
        f"{samples.label}gap of {in_ms(samples.steps[k])} after {samples.at(k)} "
        f"({many(mask.sum(), 'gap')}, {in_s(missing)} missing in all)"
    ]


def jitter_line(samples: Samples) -> list[str]:
    """One line about steps off the nominal one; none if they are within JITTER of it."""
    regular = ~(samples.gap | samples.jump)
    off = np.where(regular, np.abs(samples.steps - samples.nominal_ns), 0.0)
    if off.size == 0 or off.max() <= JITTER * samples.nominal_ns:
        return []
    k = int(np.argmax(off))
    return [
        f"{samples.label}jitter: steps differ from {in_ms(samples.nominal_ns)} by up to {in_ms(off[k])} "
        f"(99 % by at most {in_ms(np.percentile(off[regular], 99))}), most after {samples.at(k)}"
    ]


def widest(steps: NDArray[np.int64], mask: Mask) -> int:
    """The index of the longest of the steps in `mask`."""
    return int(np.argmax(np.where(mask, steps, -1)))


def in_ms(ns: float) -> str:
    """Nanoseconds as text, in milliseconds."""
    return f"{ns / 1e6:.6g} ms"


def in_s(ns: float) -> str:
    """Nanoseconds as text, in seconds."""
    return f"{ns / 1e9:.9g} s"


def many(count: int, noun: str) -> str:
    """`count` of a noun with a regular plural."""
    return f"{count} {noun}{'' if count == 1 else 's'}"
