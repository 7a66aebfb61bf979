"""What changed between two stores of the same trials, another ECU in them: verdicts, kinds, times to detect.

Belongs here: matching, comparing, the table for a terminal. Never: waveforms; the page draws those.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from campaigns.errors import CampaignError
from campaigns.outcomes import key_of, rank, td_s
from campaigns.statistics import sign_test
from campaigns.store import Document, Row

if TYPE_CHECKING:
    from rich.console import RenderableType

TOLERANCE_S = 0.010
"""One control period: an alarm cannot come between two."""

MOST = 40
"""Changed trials printed; the page and the JSON have all of them."""


def differences(a: Iterable[Row], b: Iterable[Row], tolerance_s: float = TOLERANCE_S) -> Document:
    """Store `a` against store `b`, trials matched on everything but their ECU; pairs are [a's, b's].

    changed: matched trials whose outcome, named kind or time to detect (by more than `tolerance_s`) differs.
    detections: CD lost and won from a to b where both runs are valid, and McNemar's exact p; quiet: the same
    of laps without a fault and without an alarm. times: those that grew and shrank, and the sign test's p.
    Raises CampaignError for trials that are no road trials, or differ within a store in their ECU alone, and
    for a tolerance that is none.
    """
    if not 0 <= tolerance_s < math.inf:
        raise CampaignError(f"a tolerance of {tolerance_s:g} s; it must be at least 0")
    before, after = _matchable(a, "the first store"), _matchable(b, "the second store")
    both = sorted(before.keys() & after.keys(), key=lambda key: _place(before[key]))
    pairs = [(before[key], after[key]) for key in both]
    changed = [change for pair in pairs if (change := _change(*pair, tolerance_s))["what"]]
    later = sum(_later(x, y, tolerance_s) for x, y in pairs)
    earlier = sum(_later(y, x, tolerance_s) for x, y in pairs)
    return {
        "tolerance_s": tolerance_s,
        "matched": len(pairs),
        "unchanged": len(pairs) - len(changed),
        "detections": _lost_and_won(pairs, "CD"),
        "quiet": _lost_and_won(pairs, "OK"),
        "times": {"later": later, "earlier": earlier, "p": sign_test(later, earlier)},
        "outcomes": _moves(pairs),
        "changed": changed,
        "only_a": _alone(before[key] for key in before.keys() - after.keys()),
        "only_b": _alone(after[key] for key in after.keys() - before.keys()),
    }


def difference_tables(found: Document, name_a: str, name_b: str) -> list[RenderableType]:
    """What a terminal shows of `differences`, the summary first."""
    from rich.markup import escape
    from rich.table import Table

    lines = [escape(line) for line in summary(found, name_a, name_b)]
    if not found["changed"]:
        return ["\n".join(lines)]
    table = Table(title="Changed", title_justify="left", caption_justify="left")
    for head in ("Condition", "fault", "outcome", "named", "TD s"):
        table.add_column(head)
    for change in found["changed"][:MOST]:
        cells = (_arrow(change[what]) for what in ("outcome", "named", "td_s"))
        table.add_row(*map(escape, (key_of(change), change["fault"], *cells)))
    if len(found["changed"]) > MOST:
        table.caption = f"and {len(found['changed']) - MOST} more: --json and --html have all"
    return ["\n".join(lines), table]


def summary(found: Document, name_a: str, name_b: str) -> list[str]:
    """The differences in a few lines."""
    times = found["times"]
    lines = [f"{name_a} -> {name_b}: {len(found['changed'])} of {found['matched']} matched trials changed"]
    for name, part in (("detections", found["detections"]), ("laps without an alarm", found["quiet"])):
        lines.append(
            f"{name}: {part['lost']} lost, {part['won']} won of {part['n']} valid in both "
            f"(McNemar, exact: p = {part['p']:.3g})"
        )
    lines.append(
        f"time to detect: {times['later']} later, {times['earlier']} earlier by more than "
        f"{1000 * found['tolerance_s']:g} ms (sign test: p = {times['p']:.3g})"
    )
    moves = [
        f"{move['a']} -> {move['b']} {move['n']}" for move in found["outcomes"] if move["a"] != move["b"]
    ]
    lines += [f"outcomes: {', '.join(moves)}"] * bool(moves)
    for name, alone in ((name_a, found["only_a"]), (name_b, found["only_b"])):
        lines += [f"only in {name}: {len(alone)} trials"] * bool(alone)
    return lines


def _matchable(rows: Iterable[Row], where: str) -> dict[str, Row]:
    found: dict[str, Row] = {}
    for row in rows:
        if row.trial.get("kind") != "road":
            raise CampaignError(
                f"{where}: trial {row.id} is no road trial; only those have verdicts to compare"
            )
        key = json.dumps({**row.trial, "ecu": None}, sort_keys=True)
        if key in found:
            raise CampaignError(
                f"{where}: trials {found[key].id} and {row.id} differ in their ECU alone; "
                "a comparison needs one ECU in each store"
            )
        found[key] = row
    return found


def _place(row: Row) -> tuple[Any, ...]:
    trial = row.trial
    lap = {"lap": trial["lap"].get("seed", trial["lap"].get("file"))}
    return bool(trial["fault"]), trial["condition"], rank(trial["parameters"]), rank(lap), row.id


def _lost_and_won(pairs: Iterable[tuple[Row, Row]], wanted: str) -> Document:
    """Runs that ended as `wanted` in a alone and in b alone: with a fault CD is wanted, without one OK."""
    ended = [
        (a.result["outcome"], b.result["outcome"])
        for a, b in pairs
        if bool(a.trial["fault"]) == (wanted == "CD")
    ]
    counted = [pair for pair in ended if "INVALID" not in pair]
    lost = sum(a == wanted != b for a, b in counted)
    won = sum(a != wanted == b for a, b in counted)
    return {"n": len(counted), "lost": lost, "won": won, "p": sign_test(lost, won)}


def _later(a: Row, b: Row, tolerance_s: float) -> bool:
    """Whether both found the fault, b later than a."""
    first, second = td_s(a.result), td_s(b.result)
    if first is None or second is None:
        return False
    # In whole nanoseconds: 0.43 - 0.42 s is more than 0.01 s in floating point.
    return round((second - first) * 1e9) > round(tolerance_s * 1e9)


def _change(a: Row, b: Row, tolerance_s: float) -> Document:
    what = [field for field in ("outcome", "named") if a.result[field] != b.result[field]]
    what += ["td_s"] * (_later(a, b, tolerance_s) or _later(b, a, tolerance_s))
    return {
        "what": what,
        "a": a.id,
        "b": b.id,
        **_about(a),
        **{field: [row.result[field] for row in (a, b)] for field in ("outcome", "named", "reason")},
        "td_s": [td_s(row.result) for row in (a, b)],
    }


def _about(row: Row) -> Document:
    return {field: row.trial[field] for field in ("condition", "parameters", "lap", "fault")}


def _moves(pairs: Iterable[tuple[Row, Row]]) -> list[Document]:
    counts: dict[tuple[str, str], int] = {}
    for a, b in pairs:
        move = a.result["outcome"], b.result["outcome"]
        counts[move] = counts.get(move, 0) + 1
    return [{"a": a, "b": b, "n": n} for (a, b), n in sorted(counts.items())]


def _alone(rows: Iterable[Row]) -> list[Document]:
    return [{"id": row.id, **_about(row)} for row in sorted(rows, key=_place)]


def _arrow(pair: list[Any]) -> str:
    a, b = ("-" if each is None else f"{each:.2f}" if isinstance(each, float) else str(each) for each in pair)
    return a if a == b else f"{a} -> {b}"
