"""HTML pages of soft sensors: REC and SOE curves, and the worst lap against time.

Belongs here: figures. Never: a measure.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from bench.cli.page import frame, plot, subplots, table

if TYPE_CHECKING:
    from rich.table import Table

    from campaigns.narx import Measured

MOST_PERCENT = 40.0
"""Where the tolerance axes end: what errs more is shown by the table."""


def curves_page(title: str, measured: Measured, figures: Table) -> str:
    """The table, the curves of every predictor (figures III.8 and III.16), and the first one's worst run."""
    cells = [list(column.cells) for column in figures.columns]
    rows = [[str(cell) for cell in row] for row in zip(*cells, strict=True)]
    heads = [str(column.header) for column in figures.columns]
    return frame(title, [table(heads, rows), plot(_curves(measured))])


def _curves(measured: Measured) -> Any:
    import numpy as np
    from plotly.colors import qualitative
    from plotly.graph_objects import Scatter

    from campaigns.soft_sensor import WASHOUT, pairs
    from campaigns.soft_sensor_tables import WINDOWS_MS
    from targets.narx import curves, measures

    rate = measured.data.rate_hz
    first = measured.predictors[0]
    runs = pairs(first, measured.data)
    worst = int(np.argmax([measures.rmse(p[WASHOUT:], y[WASHOUT:]) for p, y in runs]))
    titles = ["REC (III.3): share of samples within", "SOE (III.4): share of windows beyond"]
    titles += [f"{measured.sources[worst]}: {first.name}, the worst run", "its error, mm"]
    figure = subplots(titles, 2, 420, 100)
    for k, predictor in enumerate(measured.predictors):
        colour = qualitative.D3[k % len(qualitative.D3)]
        errors = measures.deviations(pairs(predictor, measured.data), WASHOUT)
        lines = [("", 1, curves.rec(errors), "solid")]
        for ms, dash in zip(WINDOWS_MS, ("solid", "dot"), strict=True):
            samples = max(1, round(ms * rate / 1000.0))
            lines.append((f", L = {ms} ms", 2, curves.soe(errors, samples), dash))
        for suffix, column, curve, dash in lines:
            figure.add_trace(
                Scatter(
                    x=curve.tolerance_percent,
                    y=curve.share,
                    name=predictor.name + suffix,
                    mode="lines",
                    line={"shape": "hv", "width": 1.5, "color": colour, "dash": dash},
                ),
                row=1,
                col=column,
            )
    predicted, y = runs[worst]
    t_s = np.arange(len(y)) / rate
    for name, values, column in (
        ("measured", y, 1),
        ("predicted", predicted, 1),
        ("error", predicted - y, 2),
    ):
        figure.add_trace(
            Scatter(x=t_s, y=values.astype(np.float32), name=name, mode="lines", line={"width": 1}),
            row=2,
            col=column,
        )
    figure.update_xaxes(range=[0, MOST_PERCENT], title_text="tolerance, %", row=1)
    figure.update_xaxes(title_text="time, s", row=2)
    return figure
