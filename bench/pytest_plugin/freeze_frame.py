"""The freeze frame of a failed test: instants, faults, last values, the waveform with the instants marked.

Belongs here: what is shown, as text. Never: drawing itself (draw), where the text goes.
"""

import sys
from collections.abc import Sequence
from contextlib import redirect_stdout
from shutil import get_terminal_size

import numpy as np

from bench.cli.draw import Style, curves, style_for
from bench.pytest_plugin.expect import Instant, Unmet, instants, seconds
from bench.pytest_plugin.health import complaints
from bench.pytest_plugin.ride import Bench
from bench.watch import STATUS

WIDEST = 100
LEAST_NS, MOST_NS = 250_000_000, 2_000_000_000
"""As much is drawn before the first instant as after it, within these bounds."""

ROWS = 6
MEASURED = "STROKES", "rear_stroke_mm"
PREDICTED = "predicted_mm", "residual_pct"


def freeze_frame(bench: Bench, error: BaseException | None = None) -> str:
    """The bench at this instant in lines of text; `error`: what failed, whose deadline is marked."""
    verdict = bench.verdict
    marks = {instant.name: instant for instant in instants(verdict)}
    if isinstance(error, Unmet):
        marks |= {instant.name: instant for instant in error.instants}
    known = sorted(marks.values(), key=lambda instant: instant.t_ns)
    fitted, watch = bench.ecu.fitted, bench.watch
    time, lap = "wall" if bench.live else "virtual", bench.lap.source or bench.lap.digest()[:12]
    lines = [
        f"bench time {seconds(bench.now_ns)} of {seconds(bench.rig.end_ns)}, {time} time; "
        f"ecu {fitted.role}, {fitted.place}; lap {lap}",
        f"so far {verdict.outcome}: {verdict.reason}",
        f"bus load {100 * bench.load:.1f} %, {watch.answered} answers to {watch.cycles} input cycles",
        *(f"bus unhealthy: {line}" for line in complaints(bench)),
        "",
        *_table([(i.name, seconds(i.t_ns), *_since(i, marks)) for i in known]),
        *_faults(bench),
        *_values(bench),
        "",
        *_waveform(bench, known),
    ]
    return "\n".join(line.rstrip() for line in lines)


def _since(instant: Instant, marks: dict[str, Instant]) -> tuple[str, ...]:
    """How long after the fault began to act."""
    active = marks.get("t_active")
    if active is None or instant is active or instant.t_ns < active.t_ns:
        return ()
    return (f"t_active + {seconds(instant.t_ns - active.t_ns)}",)


def _faults(bench: Bench) -> list[str]:
    rows = [(str(entry.number), str(entry.state), str(entry.spec)) for entry in bench.faults.entries()]
    return ["", "faults", *_table(rows)] if rows else ["", "no fault"]


def _values(bench: Bench) -> list[str]:
    """The last value of each signal, a message a line."""
    rows = []
    for message in bench.bus.seen():
        t_ns, values = bench.bus.decoded(message)
        if not len(t_ns):
            continue
        said = (
            f"{name} {values[name][-1]:.6g} {signal.unit}".rstrip() + _called(signal.names, values[name][-1])
            for name, signal in message.signals.items()
        )
        rows.append((message.name, seconds(int(t_ns[-1])), ", ".join(said)))
    return ["", "last values", *_table(rows)] if rows else ["", "no frame was heard"]


def _called(names: object, value: float) -> str:
    name = names.get(int(value)) if isinstance(names, dict) else None
    return f" ({name})" if name else ""


def _table(rows: Sequence[tuple[str, ...]]) -> list[str]:
    """Columns as wide as they need to be."""
    wide = [max((len(row[k]) for row in rows if k < len(row)), default=0) for k in range(4)]
    return ["  " + "  ".join(f"{cell:{wide[k]}}" for k, cell in enumerate(row)) for row in rows]


def _waveform(bench: Bench, marks: list[Instant]) -> list[str]:
    """Measured stroke, its prediction and the residual around the instants, which are marked below."""
    end_ns = bench.now_ns
    first_ns = min((mark.t_ns for mark in marks if mark.t_ns <= end_ns), default=end_ns - MOST_NS)
    begin_ns = max(first_ns - min(max(end_ns - first_ns, LEAST_NS), MOST_NS), 0)
    grid = np.append(np.arange(begin_ns, end_ns, bench.script.cycle_ns), end_ns)
    channels = {}
    for name, signal in (MEASURED, *((STATUS[bench.watch.role], signal) for signal in PREDICTED)):
        message = bench.watch.codec.message(name)
        if signal not in message.signals:
            continue
        t_ns, values = bench.bus.decoded(message)
        if len(t_ns):
            held = np.searchsorted(t_ns, grid, side="right") - 1
            label = f"measured {signal}" if message.name == MEASURED[0] else signal
            channels[label] = values[signal][np.maximum(held, 0)]
    if len(grid) < 2 or not channels:
        return ["no waveform: too little has been ridden"]
    with redirect_stdout(sys.__stdout__ or sys.stdout):  # the terminal, not what captures a test's output
        style = style_for()
    width = min(get_terminal_size().columns, WIDEST)
    t_s = grid / 1e9
    lines = curves(t_s, channels, 10 * bench.script.cycle_ns / 1e9, width, style, ROWS)
    return _marked(lines, marks, (float(t_s[0]), float(t_s[-1])), width, style)


def _marked(
    lines: list[str], marks: list[Instant], span_s: tuple[float, float], width: int, style: Style
) -> list[str]:
    """The drawing with a line through it at each instant, named below; those outside are left out."""
    origin = lines[-2].index(style.corner) + 1
    columns = width - origin
    through = "|" if style.line == "|" else "┊"
    begin, end = span_s
    inside = [(mark, (mark.t_ns / 1e9 - begin) / (end - begin)) for mark in marks]
    at = [(mark, origin + round(share * (columns - 1))) for mark, share in inside if 0 <= share <= 1]
    drawn = []
    for number, line in enumerate(lines):
        cells = list(line.ljust(width))
        if number < len(lines) - 2 and number % (ROWS + 1):
            for _, column in at:
                if cells[column] in (" ", "\u2800"):
                    cells[column] = through
        drawn.append("".join(cells).rstrip())
    for mark, column in at:
        text = f"{mark.name} {seconds(mark.t_ns)}"
        left = column + 2 if column + 2 + len(text) <= width else column - 1 - len(text)
        cells = list(" " * (width + 1))
        cells[column] = "^"
        cells[left : left + len(text)] = text
        drawn.append("".join(cells).rstrip())
    return drawn
