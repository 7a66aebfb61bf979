"""Drawing in the terminal: curves as braille or ASCII, bars, numbers short enough for a table.

Belongs here: what turns numbers into lines of text of a given width. Never: a lap file, nor printing.
"""

from __future__ import annotations

import math
import sys
from typing import TYPE_CHECKING, NamedTuple

from bench.printable import printable

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import numpy as np
    from numpy.typing import NDArray

    Values = NDArray[np.float64]

ROWS = 7
UNITS = {"mm": "mm", "dps": "deg/s", "kmh": "km/h", "ms2": "m/s2"}
"""Ending of a channel's name -> how its unit is written."""


class Style(NamedTuple):
    """What curves and bars are made of. `dots`: columns and rows of dots in a character."""

    dots: tuple[int, int]
    corner: str
    line: str
    tick: str
    below: str
    under: str
    bar: str


BRAILLE = Style((2, 4), "└", "│", "┤", "─", "┬", " ▏▎▍▌▋▊▉█")
ASCII = Style((1, 2), "+", "|", "+", "-", "+", " #")


def style_for(ascii_only: bool = False) -> Style:
    """Braille where the output can carry it, else ASCII."""
    if ascii_only:
        return ASCII
    try:
        "⣿└│┤─┬█".encode(sys.stdout.encoding or "ascii")
    except (UnicodeEncodeError, LookupError):
        return ASCII
    return BRAILLE


def plain(text: str) -> str:
    """A name as the output can show it: what it cannot carry, and what would steer a terminal, is escaped."""
    encoding = sys.stdout.encoding or "ascii"
    return printable(text).encode(encoding, "backslashreplace").decode(encoding)


def unit_of(channel: str) -> str:
    """The unit a channel's name ends in, as it is written."""
    ending = channel.rsplit("_", 1)[1]
    return UNITS.get(ending, ending)


def number(value: float, decimals: int = 2) -> str:
    """A number for a table: '-' for NaN, an exponent where it would be too long."""
    if math.isnan(value):
        return "-"
    return f"{value:.{decimals}f}" if abs(value) < 1e7 else f"{value:.3g}"


def bar(share: float, width: int, style: Style) -> str:
    """`share` (0 to 1) of `width` characters; what is more than nothing shows."""
    if not share > 0:
        return ""
    parts = len(style.bar) - 1
    filled = min(max(1, round(share * width * parts)), width * parts)
    return style.bar[-1] * (filled // parts) + style.bar[filled % parts].strip()


def envelope(t: Values, values: Values, edges: Values, longest: float) -> tuple[Values, Values]:
    """Lowest and highest point of the curve through the samples in each interval between `edges`.

    Between samples the curve is straight, and there is none where they are more than `longest` apart.
    float64 (edges - 1,) each; NaN for an interval that holds nothing.
    """
    import numpy as np

    low, high = np.full(len(edges) - 1, np.inf), np.full(len(edges) - 1, -np.inf)
    first = np.searchsorted(t, edges)  # of each interval; a sample on an edge belongs to the right one
    some = np.flatnonzero(np.diff(first) > 0)
    if some.size:
        inside = values[: first[-1]]
        low[some] = np.minimum.reduceat(inside, first[some])
        high[some] = np.maximum.reduceat(inside, first[some])
    # Where the curve crosses the edges it belongs to both sides: so the columns of a drawing hang together.
    after = np.clip(first, 1, len(t) - 1)
    crossed = np.interp(edges, t, values)
    outside = (edges < t[0]) | (edges > t[-1]) | (t[after] - t[after - 1] > longest)
    for side in (slice(None, -1), slice(1, None)):
        there = ~outside[side]
        low[there] = np.minimum(low[there], crossed[side][there])
        high[there] = np.maximum(high[there], crossed[side][there])
    empty = low > high
    low[empty] = high[empty] = np.nan
    return low, high


def ticks(low: float, high: float, most: int) -> list[float]:
    """The multiples of a round step (1, 2 or 5) from `low` to `high`, at most `most` (two or more)."""
    rough = high / most - low / most
    power = 10.0 ** math.floor(math.log10(rough))
    for factor in (1, 2, 5, 10, 20, 50):
        step = factor * power
        first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
        if last - first < most:
            break
    # Multiples, not sums: 0.1 + 0.2 is no round number.
    return [k * step for k in range(first, last + 1)]


def labels(values: Sequence[float]) -> list[str]:
    """Tick values as text, all with as many decimals as their step needs."""
    step = values[1] - values[0] if len(values) > 1 else abs(values[0]) if values else 0.0
    decimals = max(0, -math.floor(math.log10(step) + 1e-9)) if step else 0
    long = decimals > 6 or any(abs(value) >= 1e6 for value in values)
    return [f"{value:.4g}" if long else f"{value:.{decimals}f}" for value in values]


def curves(
    t_s: Values,
    channels: Mapping[str, Values],
    longest_s: float,
    width: int,
    style: Style,
    height: int = ROWS,
) -> list[str]:
    """The channels drawn one below the other over one time axis: lines of at most `width` characters.

    longest_s: samples further apart are not joined.
    """
    import numpy as np

    scales = {name: _Scale.of(values, height * style.dots[1]) for name, values in channels.items()}
    margin = max(len(label) for scale in scales.values() for label in labels(scale.ticks))
    columns = max(width - margin - 1, 8)
    edges = np.linspace(t_s[0], t_s[-1], columns * style.dots[0] + 1)
    lines = []
    for name, values in channels.items():
        scale = scales[name]
        low, high = (scale.dot(side) for side in envelope(t_s, values, edges, longest_s))
        marks = scale.dot(np.array(scale.ticks))
        at = {
            height - 1 - int(mark) // style.dots[1]: label
            for mark, label in zip(marks, labels(scale.ticks), strict=True)
        }
        lines.append(f"{name}, {unit_of(name)}")
        for k, row in enumerate(_characters(low, high, height, style)):
            lines.append(f"{at.get(k, ''):>{margin}}{style.tick if k in at else style.line}{row}".rstrip())
    return lines + _time_axis(float(t_s[0]), float(t_s[-1]), margin, columns, style)


class _Scale(NamedTuple):
    """From values to dots, counted from below."""

    low: float
    high: float
    dots: int
    ticks: list[float]

    @classmethod
    def of(cls, values: Values, dots: int) -> _Scale:
        low, high = float(values.min()), float(values.max())
        size = max(abs(low), abs(high))
        if high / 2 - low / 2 <= 1e-9 * size:  # a constant is drawn in the middle
            room = 0.1 * size or 1.0
            low, high = low - room, high + room
        return cls(low, high, dots, ticks(low, high, 4))

    def dot(self, values: Values) -> Values:
        import numpy as np

        # Halves: the range of what float64 holds is beyond what it holds.
        share = (values / 2 - self.low / 2) / (self.high / 2 - self.low / 2)
        dots: Values = np.rint(share * (self.dots - 1))
        return dots


def _characters(low: Values, high: Values, height: int, style: Style) -> list[str]:
    """Rows of characters, top first, with the dots from `low` to `high` set in each column of dots."""
    import numpy as np

    across, down = style.dots
    dot = np.arange(height * down)[::-1, None]
    cells = ((dot >= low) & (dot <= high)).reshape(height, down, -1, across)
    codes = np.einsum("rdca,da->rc", cells.astype(int), np.array(_BITS[style.dots]))
    table = " '.:" if style.dots == ASCII.dots else " " + "".join(chr(0x2800 + k) for k in range(1, 256))
    return ["".join(table[code] for code in row) for row in codes]


_BITS = {(1, 2): [[1], [2]], (2, 4): [[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]]}


def _time_axis(start: float, end: float, margin: int, columns: int, style: Style) -> list[str]:
    marks = ticks(start, end, max(2, columns // 10))
    rule, below = [style.below] * columns, [" "] * (margin + 1 + columns)
    for mark, label in zip(marks, labels(marks), strict=True):
        column = round((mark - start) / (end - start) * (columns - 1))
        rule[column] = style.under
        text = f"{label} s" if mark == marks[-1] else label
        left = min(max(margin + 1 + column - len(label) // 2, 0), len(below) - len(text))
        below[left : left + len(text)] = text
    return [" " * margin + style.corner + "".join(rule), "".join(below).rstrip()]
