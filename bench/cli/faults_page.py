"""The HTML page of a fault kind: its text, and a short ride without and with the fault over each other.

Belongs here: the figure. Never: a trace.
"""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING, Any

from bench.cli.page import frame, plot, subplots

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bench.faults.example import Example


def fault_page(shown: Example, lines: Sequence[str]) -> str:
    """A page of `lines` and the fault's traces."""
    body = [f"<p>{escape(line)}</p>" for line in lines]
    return frame(f"Fault: {shown.spec.kind}", [*body, plot(_figure(shown))])


def _figure(shown: Example) -> Any:
    from plotly.graph_objects import Scatter

    from bench.cli.draw import unit_of

    panels = list(dict.fromkeys(_quantity(name) for name in shown.traces))
    titles = [f"{_quantity(name)}, {unit_of(name)}" for name in shown.traces if "_faulty_" in name]
    figure = subplots(titles, 1, 220, 60, shared_xaxes=True)
    for name, values in shown.traces.items():
        faulty = "_faulty_" in name
        figure.add_trace(
            Scatter(
                x=shown.t_s,
                y=values,
                name="faulty" if faulty else "healthy",
                legendgroup=str(faulty),
                showlegend=_quantity(name) == panels[0],
                mode="lines",
                line={"width": 1, "shape": "hv", "color": "#d62728" if faulty else "#1f77b4"},
            ),
            row=panels.index(_quantity(name)) + 1,
            col=1,
        )
    figure.update_xaxes(title_text="time, s", row=len(panels), col=1)
    return figure


def _quantity(name: str) -> str:
    return name.replace("_healthy_", "_faulty_").partition("_faulty_")[0]
