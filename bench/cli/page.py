"""HTML pages of laps: one file each, plotly.js inside, nothing fetched from anywhere; same laps, same bytes.

Belongs here: figures and the frame around them. Never: a measure.
"""

from __future__ import annotations

from html import escape
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from bench.errors import RecordError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from bench.laps.describe import Motion
    from bench.laps.lap import Lap

    Row = Sequence[str]
    """A table's row; a name alone is a heading."""

MOST = 10_000
"""Intervals of a channel's envelope: seven of them are 1 MB, whatever the lap's length."""

_FRAME = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; script-src 'unsafe-inline';
 style-src 'unsafe-inline'; img-src data: blob:; form-action 'none'">
<title>{title}</title>
<style>
body {{ font: 14px/1.5 sans-serif; margin: 1em 2em; color: #222 }}
table {{ border-collapse: collapse; margin: 1em 0 }}
th, td {{ padding: 0.1em 0.8em; text-align: right; white-space: pre; font-variant-numeric: tabular-nums }}
th:first-child, td:first-child {{ text-align: left }}
tr.section td {{ font-weight: bold; padding-top: 0.8em }}
code {{ overflow-wrap: anywhere }}
{style}</style>
</head>
<body>
<h1>{title}</h1>
{body}
</body>
</html>
"""


def check_target(out: Path, laps: Sequence[Path]) -> None:
    """Raise RecordError for what would only show at the end: no plotly, no folder, a lap in its place."""
    from bench.whole import check_writable

    if find_spec("plotly") is None:
        raise RecordError(f"{out}: needs plotly: pip install 'strokebench[report]'")
    check_writable(out)
    for lap in laps:
        if out.exists() and lap.exists() and out.samefile(lap):
            raise RecordError(f"{out}: is the lap itself")


def write_page(out: Path, text: str) -> None:
    """Write a page, whole or not at all."""
    from bench.whole import whole

    with whole(out) as part:
        # A file's name may hold bytes that are no text.
        part.write_text(text, encoding="utf-8", errors="backslashreplace")


def lap_page(lap: Lap, part: Lap, lines: Sequence[str], heads: Sequence[str], rows: Sequence[Row]) -> str:
    """The page of a lap: `lines` about it, the table, the channels of `part` over one axis, provenance."""
    reduced_ms = part.duration_ns / 1e6 / MOST if len(part.t_ns) > 2 * MOST else 0.0
    body = [f"<p>{escape(line)}</p>" for line in lines]
    body.append(table(heads, rows))
    if reduced_ms:
        body.append(
            f"<p>Drawn: lowest and highest value of every {reduced_ms:.3g} ms; a shorter section "
            "(<code>--from S --to S</code>) is drawn with every sample.</p>"
        )
    return frame(lap.source, [*body, plot(_courses(part)), _provenance([lap])])


def comparison_page(
    motions: Mapping[str, Mapping[str, Motion]],
    laps: Sequence[Lap],
    heads: Sequence[str],
    rows: Sequence[Row],
) -> str:
    """The page of a comparison: the table, each stroke's spectra and speeds over each other, provenance.

    motions: name of a stroke -> name of a column -> the motion there.
    """
    body = [table(heads, rows), plot(_overlaid(motions)), _provenance(laps)]
    return frame("Laps compared", body)


def frame(title: str, body: Sequence[str], style: str = "") -> str:
    """A whole page of parts that are HTML already; style: CSS of its own."""
    return _FRAME.format(title=escape(title), body="\n".join(body), style=style)


def table(heads: Sequence[str], rows: Sequence[Row]) -> str:
    """A table as HTML; a row of a name alone is a heading within it."""
    lines = ["<tr>" + "".join(f"<th>{escape(head)}</th>" for head in heads) + "</tr>"]
    for name, *cells in rows:
        kind = "" if cells else ' class="section"'
        lines.append(f"<tr{kind}>" + "".join(f"<td>{escape(cell)}</td>" for cell in (name, *cells)) + "</tr>")
    return "<table>\n" + "\n".join(lines) + "\n</table>"


def _provenance(laps: Sequence[Lap]) -> str:
    from bench.provenance import versions

    rows = [(lap.source, lap.digest()) for lap in laps]
    made_with = ", ".join(f"{name} {version}" for name, version in versions().items())
    return (
        table(("file", "sha256 of the lap"), rows) + f"\n<p>Made with <code>{escape(made_with)}</code>.</p>"
    )


def plot(figure: Any) -> str:
    """A plotly figure as HTML, plotly.js in it: one a page."""
    from plotly.io import to_html

    text: str = to_html(
        figure,
        full_html=False,
        include_plotlyjs=True,
        div_id="plot",  # otherwise drawn by chance
        # Share buttons would carry the lap to somebody's server.
        config={"displaylogo": False, "responsive": True, "showSendToCloud": False, "plotlyServerURL": ""},
    )
    return text


def scripts(data: Any, code: str) -> str:
    """plotly.js once, `data` as JSON in the element #data, and `code`, which may draw any number of plots."""
    import json

    from plotly.offline import get_plotlyjs

    # No text in the data can end the element it stands in.
    text = json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    return (
        f"<script>{get_plotlyjs()}</script>\n"
        f'<script type="application/json" id="data">{text}</script>\n'
        f"<script>{code}</script>"
    )


def subplots(titles: Sequence[str], columns: int, height: int, apart: int, **more: Any) -> Any:
    """An empty figure of one plot a title, `columns` beside each other, each `height` pixels high."""
    from plotly.subplots import make_subplots

    count = -(-len(titles) // columns)
    figure = make_subplots(
        rows=count,
        cols=columns,
        subplot_titles=titles,
        vertical_spacing=apart / (height * count),
        **more,
    )
    figure.update_layout(template="plotly_white", height=height * count + 100, margin={"t": 40, "b": 50})
    return figure


def _courses(part: Lap) -> Any:
    import numpy as np
    from plotly.graph_objects import Scatter

    from bench.cli.draw import envelope, unit_of
    from bench.laps.steps import GAP

    t_s = part.t_ns / 1e9
    longest_s = GAP * float(np.median(np.diff(t_s)))
    figure = subplots([f"{name}, {unit_of(name)}" for name in part.channels], 1, 190, 60, shared_xaxes=True)
    edges = np.linspace(t_s[0], t_s[-1], MOST + 1)
    for row, (name, values) in enumerate(part.channels.items(), 1):
        if len(t_s) > 2 * MOST:
            low_high = np.stack(envelope(t_s, values, edges, longest_s), axis=1).ravel()
            course = {
                "x0": t_s[0],
                "dx": (t_s[-1] - t_s[0]) / len(low_high),
                "y": low_high.astype(np.float32),
            }
        else:
            # A point that is none breaks the line where nothing was recorded.
            gaps = np.flatnonzero(np.diff(t_s) > longest_s) + 1
            course = {"x": np.insert(t_s, gaps, t_s[gaps - 1]), "y": np.insert(values, gaps, np.nan)}
        figure.add_trace(
            Scatter(name=name, mode="lines", line={"width": 1}, showlegend=False, **course), row=row, col=1
        )
    figure.update_xaxes(title_text="time, s", row=len(part.channels), col=1)
    return figure


def _overlaid(motions: Mapping[str, Mapping[str, Motion]]) -> Any:
    import numpy as np
    from plotly.colors import qualitative
    from plotly.graph_objects import Scatter

    from bench.laps.describe import GRID_HZ, SPEEDS_MM_S

    titles = [f"{name}: {what}" for name in motions for what in ("power density", "share of time at a speed")]
    figure = subplots(titles, 2, 420, 100)
    names = list(dict.fromkeys(name for columns in motions.values() for name in columns))
    for row, columns in enumerate(motions.values(), 1):
        for name, motion in columns.items():
            curves = (
                (GRID_HZ[1:], motion.density[1:]),
                ((SPEEDS_MM_S[1:] + SPEEDS_MM_S[:-1]) / 2, 100 * motion.histogram),
            )
            for col, (x, y) in enumerate(curves, 1):
                k = names.index(name)
                figure.add_trace(
                    Scatter(
                        x=x,
                        y=np.where(y > 0, y, np.nan),
                        name=escape(name.encode(errors="backslashreplace").decode()),
                        legendgroup=str(k),
                        showlegend=row == col == 1,
                        mode="lines",
                        line={"width": 1.5, "color": qualitative.D3[k % len(qualitative.D3)]},
                    ),
                    row=row,
                    col=col,
                )
        figure.update_xaxes(title_text="Hz", type="log", row=row, col=1)
        figure.update_yaxes(title_text="mm²/Hz", type="log", exponentformat="power", row=row, col=1)
        figure.update_xaxes(title_text="mm/s, compression positive", row=row, col=2)
        figure.update_yaxes(title_text="% in 50 mm/s", type="log", exponentformat="power", row=row, col=2)
    return figure
