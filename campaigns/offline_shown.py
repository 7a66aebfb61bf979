"""The offline campaign's tables on a terminal and on a page.

Belongs here: what hands `offline_tables`' grids and the document's curves on. Never: a figure's value.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from campaigns.offline_plan import OfflineCampaign
from campaigns.offline_tables import Grid, grids, invalid
from campaigns.sheets import Cell, Sheet
from campaigns.store import Document

if TYPE_CHECKING:
    from rich.console import RenderableType


MOST_PERCENT = 20.0
"""Where the SOE curves' axis ends, as in Figure V.7."""


def tables(plan: OfflineCampaign, document: Document) -> "list[RenderableType]":
    """What an offline campaign prints: invalid faults first, then every table; within 120 columns."""
    return [invalid(document), *(on_terminal(grid) for grid in grids(plan, document))]


def on_terminal(grid: Grid) -> "RenderableType":
    """A grid as rich prints it, its grey cells reversed."""
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, pad_edge=False)
    for head in grid.heads:
        table.add_column(head, justify="right" if table.columns else "left", overflow="fold")
    for k, row in enumerate(grid.rows):
        cells = []
        for j, cell in enumerate(row):
            first, line, below = cell.text.partition("\n")
            text = Text(first, style="reverse" if (k, j) in grid.grey else "")
            cells.append(Text("\n").join([text, Text(below, style="dim")]) if line else text)
        table.add_row(*cells)
    caption = [Text(grid.caption, style="dim")] if grid.caption else []
    return Group(Text(grid.title, style="italic"), table, *caption)


def page_parts(plan: OfflineCampaign, document: Document) -> tuple[list[Sheet], list[dict[str, Any]]]:
    """Every table and the SOE curves, as a campaign's page takes them."""
    acted = [
        [Cell(str(row[name])) for name in ("condition", "feedback", "n", "INVALID")]
        for row in document["invalid"]
    ]
    sheets = [Sheet("Faults inserted", ("Fault", "feedback", "of", "INVALID"), acted, invalid(document))]
    sheets += [Sheet(grid.title, grid.heads, grid.rows, grid.caption) for grid in grids(plan, document)]
    return sheets, [_soe_plot(name, curves) for name, curves in document["soe"].items()]


def _soe_plot(feedback: str, curves: Mapping[str, Document]) -> dict[str, Any]:
    return {
        "title": f"Figures V.6, V.7: feedback {feedback}",
        "x": "E_mean,L, %",
        "y": "share of windows beyond",
        "xaxis": {"range": [0, MOST_PERCENT]},
        "lines": [
            {"name": f"L = {L} ms", "x": curve["tolerance_percent"], "y": curve["share"]}
            for L, curve in curves.items()
        ],
    }
