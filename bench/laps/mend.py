"""A time base mended: repeats dropped, jumps closed, gaps filled, jitter resampled away.

Belongs here: what is done about each finding of `bench.laps.steps`, with the line that reports it; uniform
grids. Never: a format, nor a mend nobody asked for.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bench.errors import LapError
from bench.laps.steps import Samples, check_span, gap_line, in_ms, jitter_line, jump_line, many

FILL_NS = 100_000_000
"""Longest gap that is filled. FIDELITY: a line over 100 ms follows the body, 1 to 3 Hz, not a wheel's hop."""

LONGEST = 7_200_000
"""Most samples a time base is made of here: two hours at 1 kHz."""


def mend_clock(samples: Samples, where: str) -> tuple[Samples, list[str]]:
    """Repeated samples dropped, the first of each time kept; each jump made one nominal step.

    After a jump the rest of the recording shifts. FIDELITY: samples written out of order are taken for jumps
    of the clock. Raises LapError for times further apart than int64 nanoseconds can subtract.
    """
    check_span(samples, where)
    lines = []
    repeated = samples.steps == 0
    if repeated.any():
        same = samples.same()
        for mask, what in (
            (repeated & same, "the same again"),
            (repeated & ~same, "other values at a time already taken"),
        ):
            if mask.any():
                first = samples.at(int(np.argmax(mask)) + 1)
                lines.append(f"{samples.label}dropped {many(mask.sum(), 'sample')}, {what}, first at {first}")
        keep = np.concatenate(([True], ~repeated))
        values = {name: column[keep] for name, column in samples.values.items()}
        samples = replace(samples, t_ns=samples.t_ns[keep], values=values, number=samples.number[keep])
    back, forward = samples.steps < 0, samples.jump
    if not (back | forward).any():
        return samples, lines
    steps = np.where(back | forward, max(1, round(samples.nominal_ns)), samples.steps)
    lines += [
        f"{line}; the rest shifted, to go on at the nominal step"
        for mask in (back, forward)
        for line in jump_line(samples, mask)
    ]
    return replace(samples, t_ns=samples.t_ns[0] + np.concatenate(([0], np.cumsum(steps)))), lines


def fill_gaps(samples: Samples, where: str) -> tuple[Samples, list[str]]:
    """Gaps of up to FILL_NS filled with evenly spaced samples on straight lines; longer ones left, and said.

    Raises LapError if that makes more than LONGEST samples.
    """
    short = samples.gap & (samples.steps <= FILL_NS)
    lines = [f"{line}; left as it is" for line in gap_line(samples, samples.gap & ~short)]
    if not short.any():
        return samples, lines
    extra = np.where(short, np.rint(samples.steps / samples.nominal_ns).astype(np.int64) - 1, 0)
    total = _bounded(len(samples.t_ns) + int(extra.sum()), where, f"{samples.label}filling its gaps")
    lines += [f"{line}; filled with {many(extra.sum(), 'sample')}" for line in gap_line(samples, short)]
    place = np.concatenate(([0], np.cumsum(extra + 1)))

    def stretched(column: NDArray) -> NDArray[np.float64]:
        return np.interp(np.arange(total), place, column)

    t_ns = samples.t_ns[0] + np.rint(stretched(samples.t_ns - samples.t_ns[0])).astype(np.int64)
    t_ns[place] = samples.t_ns  # float64 is exact for 104 days only
    values = {name: stretched(column) for name, column in samples.values.items()}
    number = np.repeat(samples.number, np.concatenate((extra + 1, [1])))
    return replace(samples, t_ns=t_ns, values=values, number=number), lines


def even_out(samples: Samples, where: str) -> tuple[Samples, list[str]]:
    """Resampled on a uniform grid, on straight lines, if there is jitter; gaps beyond FILL_NS stay gaps.

    FIDELITY: no filter against aliasing; the grid is about as fine as the samples were.
    Raises LapError if that makes more than LONGEST samples.
    """
    line = jitter_line(samples)
    if not line:
        return samples, []
    steps = samples.steps[~(samples.gap | samples.jump)]
    # Not the median: a clock coarser than the step shows 3, 3 and 4 ms for 3.33. Nor the mean alone: of steps
    # that jitter by half and more the long ones have just been filled like gaps, and the short ones are left.
    count = float(np.rint(steps / samples.nominal_ns).sum())
    period = round_period_ns(float(steps.sum()) / count if count else samples.nominal_ns)
    t_ns = grid_ns(int(samples.t_ns[0]), int(samples.t_ns[-1]), period, where, samples.label)
    before = np.searchsorted(samples.t_ns, t_ns, side="right") - 1
    inside = np.append(samples.gap & (samples.steps > FILL_NS), False)[before] & (t_ns > samples.t_ns[before])
    t_ns, before = t_ns[~inside], before[~inside]
    values = {name: straight(t_ns, samples.t_ns, column) for name, column in samples.values.items()}
    even = replace(samples, t_ns=t_ns, values=values, number=samples.number[before])
    return even, [f"{line[0]}; resampled every {in_ms(period)}"]


def straight(
    at_ns: NDArray[np.int64], t_ns: NDArray[np.int64], values: NDArray[np.float64]
) -> NDArray[np.float64]:
    """`values` of the times `t_ns` at `at_ns` (samples,), on straight lines."""
    # from a common origin: float64 is exact for 104 days only
    return np.interp((at_ns - t_ns[0]).astype(np.float64), (t_ns - t_ns[0]).astype(np.float64), values)


def round_period_ns(step_ns: float) -> int:
    """The period of the roundest rate (one digit, two, whole hertz) within 1 % of a step; else the step.

    It need not be exact: samples are resampled at their own times, whatever the grid.
    """
    rate = 1e9 / step_ns
    for round_rate in (float(f"{rate:.1g}"), float(f"{rate:.2g}"), max(1.0, np.rint(rate))):
        if abs(rate - round_rate) <= 0.01 * rate:
            return max(1, round(1e9 / round_rate))
    return max(1, round(step_ns))


def grid_ns(first: int, last: int, period: int, where: str, label: str = "") -> NDArray[np.int64]:
    """int64 times from `first`, `period` apart, to `last` at most. Raises LapError beyond LONGEST samples."""
    what = f"{label}{(last - first) / 1e9:.9g} s every {in_ms(period)}"
    return first + np.arange(_bounded((last - first) // period + 1, where, what)) * period


def _bounded(samples: int, where: str, what: str) -> int:
    if samples > LONGEST:
        raise LapError(f"{where}: {what} makes {samples} samples; a lap made anew has at most {LONGEST}")
    return samples
