"""The trials on a campaign's page: a list to choose from, and what is drawn of each.

Belongs here: the list's columns and filters, freeze frames made small. Never: a measure.
"""

from __future__ import annotations

import math
from html import escape
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from campaigns.store import Document

    Frame = Callable[[str], Document | None]
    """Id of a trial -> its freeze frame."""

    Sides = Sequence[Document]
    """The same trial's exported {"id", "trial", "result"}: of one store, or before and after."""

INSTANTS = ("t_cmd", "t_active", "t_obs", "t_alarm", "t_heal")
SERIES = {"measured": "measured_mm", "predicted": "predicted_mm", "residual": "residual_pct"}
OUTCOMES = ("INVALID", "FA", "MD", "ID", "CD", "OK")
"""As they stand in the filter: what asks for a look first."""

_ROOM = """<h2>{title}</h2>
<div id="trials">
<div>
<div class="filters"><input id="words" type="search" placeholder="filter" aria-label="Filter by words">
<select id="condition" aria-label="Condition"><option value="">all conditions</option>{conditions}</select>
{outcomes} <span id="shown" class="note" aria-live="polite"></span></div>
<div class="list" id="box"><table id="list"><thead><tr>{heads}</tr></thead>
<tbody>
{rows}
</tbody></table></div>
<p class="note">A click or Enter shows a trial; the arrow keys go from one to the next.</p>
</div>
<div id="freeze"><h3 id="chosen" aria-live="polite"></h3><p id="about"></p><div id="wave"></div>
<table id="instants"></table></div>
</div>"""


def browser(title: str, trials: Sequence[Sides]) -> str:
    """The list of the trials with its filters, and the room in which the chosen one is drawn."""
    conditions = dict.fromkeys(sorted(sides[-1]["trial"]["condition"] for sides in trials))
    ended = [sides[-1]["result"]["outcome"] for sides in trials]
    buttons = [
        f'<button type="button" class="{name}" value="{name}" aria-pressed="true">'
        f"{name} {ended.count(name)}</button>"
        for name in OUTCOMES
        if name in ended
    ]
    heads = (("outcome", ""), ("condition", ""), ("TD s", "number"), ("named", ""), ("lap", ""))
    return _ROOM.format(
        title=escape(title),
        conditions="".join(f"<option>{escape(name)}</option>" for name in conditions),
        outcomes="\n".join(buttons),
        heads="".join(
            f'<th scope="col" class="{kind}"><button type="button">{head}</button></th>'
            for head, kind in heads
        ),
        rows="\n".join(_line(sides, _same_road(trials)) for sides in trials),
    )


def urgency(row: Document) -> int:
    """Where a trial's outcome stands among those that ask for a look."""
    return OUTCOMES.index(row["result"]["outcome"])


def drawn(sides: Sides, names: Sequence[str], frames: Sequence[Frame | None]) -> Document:
    """What the page draws of a trial: instants in s and the freeze frame of each side."""
    from campaigns.outcomes import key_of, lap_name

    trial = sides[-1]["trial"]
    shown, about = [], []
    for row, name, frame in zip(sides, names, frames, strict=True):
        result = row["result"]
        instants = {each: result[f"{each}_ns"] for each in INSTANTS if result[f"{each}_ns"] is not None}
        shown.append(
            {
                "name": name,
                "instants": {each: at / 1e9 for each, at in instants.items()},
                "frame": packed(frame(row["id"])) if frame else None,
            }
        )
        named = f", named {result['named']}" if result["named"] else ""
        about.append(f"{name + ': ' if name else ''}{result['outcome']}, {result['reason']}{named}")
    return {
        "id": sides[-1]["id"],
        "title": f"{key_of(trial)}: {trial['fault'] or 'no fault'}",
        "about": "; ".join(about) + f" ({lap_name(trial['lap'])})",
        "sides": shown,
    }


def packed(frame: Document | None) -> Document | None:
    """A freeze frame in hundredths, each sample as its difference from the one before: few digits."""
    if frame is None:
        return None
    series = {}
    for name, field in SERIES.items():
        before = 0
        steps: list[int | None] = []
        for value in frame[field]:
            if value is None or not math.isfinite(value):
                steps.append(None)
                continue
            now = round(100 * value)
            steps.append(now - before)
            before = now
        series[name] = steps
    return {"t0": frame["t0_ns"] / 1e9, "dt": frame["period_ns"] / 1e9, "series": series}


def _line(sides: Sides, same_road: bool) -> str:
    from campaigns.outcomes import key_of, lap_name, td_s

    last = sides[-1]
    outcomes = [side["result"]["outcome"] for side in sides]
    times = [td_s(side["result"]) for side in sides]
    named = [side["result"]["named"] or "-" for side in sides]
    condition = escape(last["trial"]["condition"])
    outcome = " → ".join(f'<span class="{each}">{each}</span>' for each in _once(outcomes))
    shown = _once(["-" if time is None else f"{time:.3f}" for time in times])
    cells = [
        f'<td data-sort="{outcomes[-1]}">'
        f'<button type="button" class="pick" tabindex="-1">{outcome}</button></td>',
        f"<td>{escape(key_of(last['trial']))}</td>",
        f'<td class="number" data-sort="{"" if times[-1] is None else times[-1]}">{" → ".join(shown)}</td>',
        f"<td>{escape(' → '.join(_once(named)))}</td>",
        f"<td>{escape(lap_name(last['trial']['lap'], not same_road))}</td>",
    ]
    attributes = f'data-id="{last["id"]}" data-outcome="{outcomes[-1]}" data-condition="{condition}"'
    return f"<tr {attributes}>{''.join(cells)}</tr>"


def _once(pair: Sequence[str]) -> list[str]:
    return list(pair[:1]) if len(set(pair)) == 1 else list(pair)


def _same_road(trials: Sequence[Sides]) -> bool:
    laps = [sides[-1]["trial"]["lap"] for sides in trials]
    return len({(lap.get("route"), lap.get("motorcycle")) for lap in laps}) == 1
