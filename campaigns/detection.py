"""Detection curves: how often a fault is found against its magnitude, and how small it may be.

Belongs here: rows in, curves as JSON-able documents out. Never: a drawing.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from campaigns.outcomes import count, number, rank, rate, valid
from campaigns.store import Document, Row

NEUTRAL = {"gain": 1.0, "by": 0.0, "mm": 0.0}
"""Parameter of a fault -> the value at which it is none; of others no smallest one is sought."""

SHARE = 0.9
"""A magnitude counts as found where this share of the runs found it."""


def detection_curves(rows: Iterable[Row]) -> list[Document]:
    """A curve of CD for each condition and each of its parameters that took two numbers or more.

    Where several were swept there is one for each combination of the others. "smallest": on each side of the
    neutral value the first magnitude from which on every one tried is found in SHARE of the runs, or null.
    """
    groups: dict[tuple[str, str, tuple[object, ...]], list[Row]] = {}
    for row in sorted(rows, key=lambda row: row.id):
        for name, value in row.trial["parameters"].items():
            if row.trial["fault"] and number(value):
                key = row.trial["condition"], name, rank(_others(row, name))
                groups.setdefault(key, []).append(row)
    curves = [_curve(key[1], groups[key]) for key in sorted(groups)]
    return [curve for curve in curves if len(curve["points"]) > 1]


def _others(row: Row, name: str) -> Document:
    return {other: value for other, value in row.trial["parameters"].items() if other != name}


def _curve(name: str, rows: Sequence[Row]) -> Document:
    at: dict[float, list[Row]] = {}
    for row in sorted(rows, key=lambda row: row.trial["parameters"][name]):
        at.setdefault(row.trial["parameters"][name], []).append(row)
    points = [_point(magnitude, group) for magnitude, group in at.items()]
    condition, others = rows[0].trial["condition"], dict(sorted(_others(rows[0], name).items()))
    fixed = "".join(f",{other}={value}" for other, value in others.items())
    neutral = NEUTRAL.get(name)
    return {
        "key": f"{condition}[{name}{fixed}]",
        "condition": condition,
        "parameter": name,
        "others": others,
        "points": points,
        "neutral": neutral,
        "share": SHARE,
        "smallest": None if neutral is None else _smallest(points, neutral),
    }


def _point(magnitude: float, rows: Sequence[Row]) -> Document:
    runs = valid(rows)
    hits = count(runs, "CD")
    return {
        "magnitude": magnitude,
        "n": len(runs),
        "invalid": len(rows) - len(runs),
        "CD": hits,
        **rate(hits, len(runs)),
    }


def _smallest(points: Sequence[Document], neutral: float) -> Document:
    found: Document = {}
    for side, sign in (("below", -1), ("above", 1)):
        found[side] = None
        beyond = [point for point in points if sign * (point["magnitude"] - neutral) > 0]
        for point in sorted(beyond, key=lambda point: -abs(point["magnitude"] - neutral)):
            # No valid run there shows nothing, and so ends what is known to be found.
            if not point["n"] or point["CD"] < SHARE * point["n"]:
                break
            # Decimals as they were written, not 0.08000000000000007.
            distance = round(abs(point["magnitude"] - neutral), 12)
            found[side] = {"magnitude": point["magnitude"], "distance": distance}
    return found
