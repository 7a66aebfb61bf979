"""The page of a campaign: its tables, times to detect, detection curves, and any trial's waveforms.

Belongs here: what stands where on the page. Never: a figure that the document lacks; the list of trials (in
`campaign_trials`), how a curve is drawn (in `campaign_page.js`). One file, nothing fetched from anywhere; the
same document and frames, the same bytes.
"""

from __future__ import annotations

import json
import math
from html import escape
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bench.cli import page
from bench.cli.campaign_trials import browser, drawn, urgency

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from bench.cli.campaign_trials import Frame
    from campaigns.sheets import Cell, Sheet
    from campaigns.store import Document

HERE = Path(__file__).parent
MOST_FRAMES = 2000
"""Trials drawn on a page, about 12 kB each: what a browser still opens without a wait."""

PER_DECADE = 10
"""Bins of the histograms of times to detect."""

_HISTOGRAM = """<h2>Times to detect</h2>
<p class="note">Runs in bins of equal ratio. Each stroke below is one run; a click shows its waveform.</p>
<div id="histogram"></div>"""


def campaign_page(
    document: Document,
    frame: Frame | None = None,
    published: Mapping[str, Any] | None = None,
    sheets: Sequence[Sheet] = (),
    plots: Sequence[Document] = (),
) -> str:
    """The page of an exported campaign (`campaigns.export.document`).

    frame: freeze frames of its road trials; without it the trials are not on the page. published: figures
    that stand beside ours in a road campaign. sheets, plots: tables and curves of the caller's own, before
    the rest; a plot is {"title", "x", "y", "lines": [{"name", "x", "y"}]}, as `_detection_curves` makes them,
    or {"figure": a plotly figure as plotly's JSON}, as wide as the page.
    """
    from campaigns.sheets import invalid_lines
    from campaigns.sheets import sheets as road_sheets

    campaign, tables = document["campaign"], document["tables"]
    road = "conditions" in tables
    body = [_lead(campaign, len(document["trials"]))]
    if road:
        body.append(_state(invalid_lines(tables)))
        sheets = [*sheets, *road_sheets(tables, published)]
        plots = [*plots, *_detection_curves(tables["curves"])]
    body += ["<h2>Results</h2>", *(_sheet(sheet) for sheet in sheets)]
    sides = [[row] for row in _ordered(document["trials"], tables)] if road and frame else []
    kept = {side[0]["id"] for side in sorted(sides, key=lambda side: urgency(side[0]))[:MOST_FRAMES]}
    trials = [drawn(side, [""], [frame if side[0]["id"] in kept else None]) for side in sides]
    histogram = _histogram(document["trials"], tables["conditions"]) if road else None
    if histogram:
        body.append(_HISTOGRAM)
    body.append(_rooms(plots))
    if trials:
        body.append(browser("Trials", sides))
        if len(sides) > MOST_FRAMES:
            body.append(
                f'<p class="note">Waveforms of {MOST_FRAMES} of {len(sides)} trials are on this page, those '
                "that did not end as they should first; the store has all.</p>"
            )
    body.append(_provenance(campaign))
    return _page(_title(campaign), body, histogram, plots, trials)


def difference_page(
    found: Document,
    names: tuple[str, str],
    trials: Sequence[Sequence[Document]],
    frames: tuple[Frame, Frame],
    campaigns: tuple[Document, Document],
) -> str:
    """The page of `campaigns.differences.differences`: every changed trial, before and after.

    trials: (a's, b's) exported {"id", "trial", "result"} of each changed trial, in the order of `found`.
    """
    from campaigns.differences import summary

    head, *lines = summary(found, *names)
    items = "".join(f"<li>{escape(line)}</li>" for line in lines)
    bad = " bad" if found["detections"]["lost"] or found["quiet"]["lost"] else ""
    body = [f'<div class="state{bad}"><b>{escape(head)}</b><ul>{items}</ul></div>']
    if trials:
        body.append(browser("Changed trials", trials))
    for name, campaign in zip(names, campaigns, strict=True):
        body.append(_provenance(campaign, f"Provenance of {name}"))
    return _page(
        f"{names[0]} against {names[1]}", body, None, [], [drawn(pair, names, frames) for pair in trials]
    )


def _ordered(trials: Sequence[Document], tables: Document) -> list[Document]:
    """Trials as the tables' conditions stand, then by parameters and lap."""
    from campaigns.outcomes import rank

    groups = [*tables["fault_free"], *tables["conditions"]]
    place = {condition: number for number, condition in enumerate(group["condition"] for group in groups)}

    def key(row: Document) -> tuple[Any, ...]:
        trial, lap = row["trial"], row["trial"]["lap"]
        return (
            place[trial["condition"]],
            rank(trial["parameters"]),
            rank({"lap": lap.get("seed", "")}),
            row["id"],
        )

    return sorted(trials, key=key)


def _page(
    title: str,
    body: Sequence[str],
    histogram: Document | None,
    plots: Sequence[Document],
    trials: Sequence[Document],
) -> str:
    data = {"histogram": histogram, "plots": plots, "trials": trials, "first": _first(trials)}
    style, code = ((HERE / f"campaign_page.{kind}").read_text(encoding="utf-8") for kind in ("css", "js"))
    quiet = "<noscript><p>The drawings need scripts; the tables stand without.</p></noscript>"
    return page.frame(title, [quiet, *body, page.scripts(data, code)], style)


def _first(trials: Sequence[Document]) -> str | None:
    """The trial shown when the page opens: one with a waveform, a fault and an alarm, if there is one."""

    def lacks(trial: Document) -> int:
        last = trial["sides"][-1]
        return 4 * (last["frame"] is None) + sum(
            name not in last["instants"] for name in ("t_active", "t_alarm")
        )

    return min(trials, key=lacks)["id"] if trials else None


def _title(campaign: Document) -> str:
    return str(campaign.get("title") or campaign.get("name") or "Campaign")


def _lead(campaign: Document, trials: int) -> str:
    ecus = {f"ECU {ecu['ecu']} on {ecu['runs_on']}": None for ecu in campaign.get("ecu") or []}
    parts = [str(campaign.get("stands_for") or campaign.get("name") or ""), *ecus]
    parts += [f"{trials} trials"] * bool(trials)
    return f'<p class="lead">{escape(" · ".join(part for part in parts if part))}</p>'


def _state(lines: Sequence[str]) -> str:
    head, *runs = lines
    items = "".join(f"<li>{escape(run)}</li>" for run in runs)
    inner = f"<b>{escape(head)}</b>" + (f"<ul>{items}</ul>" if items else "")
    return f'<div class="state{" bad" if items else ""}">{inner}</div>'


def _sheet(sheet: Sheet) -> str:
    heads = "".join(f'<th scope="col">{escape(head)}</th>' for head in sheet.heads)
    rows = "\n".join(
        "<tr>" + "".join(_cell(cell, sheet.spread) for cell in row) + "</tr>" for row in sheet.rows
    )
    note = f'\n<p class="note">{escape(sheet.note)}</p>' if sheet.note else ""
    return (
        f'<h3>{escape(sheet.name)}</h3>\n<div class="scroll"><table>\n<thead><tr>{heads}</tr></thead>\n'
        f"<tbody>\n{rows}\n</tbody></table></div>{note}"
    )


def _cell(cell: Cell, spread: str) -> str:
    kind = ' class="marked"' if cell.marked else ' class="zero"' if cell.text in ("0", "-") else ""
    if not cell.key:
        return f"<td{kind}>{escape(cell.text)}</td>"
    value = escape(json.dumps(cell.value))
    shown = escape(cell.text)
    if spread and cell.key.endswith(f".{spread}.interval") and cell.value[0] is not None:
        shown += _whisker(*cell.value)
    return f'<td{kind} data-key="{escape(cell.key)}" data-value="{value}">{shown}</td>'


def _whisker(low: float, high: float) -> str:
    """An interval between 0 and 100 %, drawn."""
    x0, x1 = (round(2 + 96 * share, 1) for share in (low, high))
    return (
        '<svg width="100" height="10" aria-hidden="true"><line class="rail" x1="2" x2="98" y1="5" y2="5"/>'
        f'<line class="reach" x1="{x0}" x2="{max(x1, x0 + 1)}" y1="5" y2="5"/></svg>'
    )


def _rooms(plots: Sequence[Document]) -> str:
    if not plots:
        return ""
    rooms = "".join(
        f'<div id="plot{number}"{" class=wide" * ("figure" in plot)}></div>'
        for number, plot in enumerate(plots)
    )
    return f'<h2>Curves</h2>\n<div class="grid">{rooms}</div>'


def _histogram(trials: Sequence[Document], groups: Sequence[Document]) -> Document | None:
    """Times to detect by condition in bins of equal logarithm, with what was missed."""
    from campaigns.outcomes import td_s

    found: dict[str, list[tuple[float, str]]] = {}
    for row in trials:
        time = td_s(row["result"])
        if time is not None:
            found.setdefault(row["trial"]["condition"], []).append((time, row["id"]))
    if not found:
        return None
    logs = [math.log10(max(time, 1e-3)) for times in found.values() for time, _ in times]
    first, last = math.floor(min(logs) * PER_DECADE), math.floor(max(logs) * PER_DECADE) + 1
    edges = [round(k / PER_DECADE, 6) for k in range(first, last + 1)]
    rows = []
    for condition in dict.fromkeys(group["condition"] for group in groups):
        times = sorted(found.get(condition, []))
        n, missed = (
            sum(group[name] for group in groups if group["condition"] == condition) for name in ("n", "MD")
        )
        bins = [math.log10(max(time, 1e-3)) for time, _ in times]
        rows.append(
            {
                "key": condition,
                "note": f"{len(times)} of {n} detected" + (f", {missed} missed" if missed else ""),
                "missed": missed,
                "counts": [sum(low <= at < high for at in bins) for low, high in pairwise(edges)],
                "td": [round(time, 6) for time, _ in times],
                "trials": [id_ for _, id_ in times],
            }
        )
    return {"edges": edges, "rows": rows}


def _detection_curves(curves: Sequence[Document]) -> list[Document]:
    """One plot for each condition and parameter; the values of the other parameters are lines in it."""
    plots: dict[tuple[str, str], Document] = {}
    for curve in curves:
        name = curve["parameter"]
        plot = plots.setdefault(
            (curve["condition"], name),
            {
                "title": f"{curve['condition']}: correct detections against {name}",
                "x": name,
                "y": "CD, % of valid runs",
                "yaxis": {"range": [-3, 105]},
                "levels": [100 * curve["share"]],
                "marks": [],
                "lines": [],
            },
        )
        points = [point for point in curve["points"] if point["n"]]
        plot["lines"].append(
            {
                "name": ", ".join(f"{other} = {value}" for other, value in curve["others"].items()) or "CD",
                "x": [point["magnitude"] for point in points],
                "y": [100 * point["value"] for point in points],
                "low": [100 * point["interval"][0] for point in points],
                "high": [100 * point["interval"][1] for point in points],
                "text": [f"{point['CD']} of {point['n']}" for point in points],
            }
        )
        if not curve["others"]:
            sides = (side for side in (curve["smallest"] or {}).values() if side)
            plot["marks"] += [{"x": side["magnitude"], "text": f"{side['magnitude']:g}"} for side in sides]
    return list(plots.values())


def _provenance(campaign: Document, head: str = "Provenance") -> str:
    """Everything that is known of how the results came about, folded up where it is long."""
    from campaigns.export import flat_columns

    plan = campaign.get("plan")
    known = flat_columns({name: value for name, value in campaign.items() if name != "plan"})
    rows = [
        f"<tr><td>{escape(name)}</td><td><code>{escape(_text(value))}</code></td></tr>"
        for name, value in known.items()
        if value is not None
    ]
    table = '<table class="provenance"><tbody>\n' + "\n".join(rows) + "\n</tbody></table>"
    text = json.dumps(plan, indent=1, ensure_ascii=False)
    folded = f"<details><summary>The plan</summary><pre>{escape(text)}</pre></details>" if plan else ""
    return f"<h2>{escape(head)}</h2>\n{table}{folded}"


def _text(value: Any) -> str:
    return f"{len(value)}: {json.dumps(value, ensure_ascii=False)}" if isinstance(value, list) else str(value)
