"""What became of a campaign's runs, as one JSON-able document: the only source of figures for every report.

Belongs here: from rows to counts, rates, times, bounds and detection curves. Never: a file, a screen, a run.

The figures are of these runs alone. No SPFM, LFM or PMHF is claimed: those weigh the failure rate of every
hardware element, and the share of its failure modes that a mechanism covers, over the whole item. A bench
knows no failure rates, and chooses how often it inserts which fault; what it can say is how large the
coverage of exactly this fault, under exactly these conditions, is at least.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from bench.errors import FaultError
from bench.faults.spec import parse_fault
from bench.printable import printable
from campaigns.statistics import Rate, Times, alarm_rate_bound, mean_and_deviation, middle, times
from campaigns.store import Document, Row

OUTCOMES = ("CD", "MD", "FA", "ID")
"""Of a run with a fault, INVALID aside; a run without one is OK or FA."""


def outcomes(rows: Iterable[Row], order: Sequence[str] = (), ftti_s: float | None = None) -> Document:
    """Every figure of a campaign's report: invalid runs, conditions, fault-free laps, step times.

    order: conditions as they shall stand, others follow by name; every point of a sweep is a row of its own.
    ftti_s: overrides the trials' own. No NaN: null is no value.
    """
    groups: dict[str, list[Row]] = {}
    for row in sorted(rows, key=lambda row: (_place(row, order), row.id)):
        groups.setdefault(key_of(row.trial), []).append(row)
    every = [row for group in groups.values() for row in group]
    return {
        "n": len(every),
        "invalid": _invalid(every),
        "conditions": [
            _condition(key, group, ftti_s) for key, group in groups.items() if group[0].trial["fault"]
        ],
        "fault_free": [
            _fault_free(key, group) for key, group in groups.items() if not group[0].trial["fault"]
        ],
        "steps": _steps(every),
    }


def expected_kind(fault: str) -> str | None:
    """What an ECU should name the fault of a trial; None: no name is right or wrong."""
    if not fault:
        return None
    try:
        return parse_fault(fault).called
    except FaultError:  # of a bench that knew other kinds
        return None


def td_s(result: Mapping[str, Any]) -> float | None:
    """Time to detect of a correct detection, s; None for every other run."""
    td_ns = result["td_ns"] if result["outcome"] == "CD" else None
    return None if td_ns is None else td_ns / 1e9


def rate(hits: int, n: int) -> Document:
    """A rate as a document: its value and 95 % Wilson interval, fractions of 1."""
    found = Rate(hits, n)
    return {"value": finite(found.value), "interval": [finite(bound) for bound in found.interval]}


def finite(value: float) -> float | None:
    """JSON knows no NaN and no infinity: None."""
    return value if math.isfinite(value) else None


def valid(rows: Iterable[Row]) -> list[Row]:
    """The rows that may enter a rate."""
    return [row for row in rows if row.result["outcome"] != "INVALID"]


def count(rows: Iterable[Row], outcome: str) -> int:
    """How many ended so."""
    return sum(row.result["outcome"] == outcome for row in rows)


def lap_name(lap: Document, road: bool = True) -> str:
    """A lap in a few words: its file, or its seed and, unless told not to, route and motorcycle."""
    if "file" in lap:
        return printable(str(lap["file"]))
    return f"seed {lap['seed']}" + (f", {lap['route']}, {lap['motorcycle']}" if road else "")


def key_of(trial: Mapping[str, Any]) -> str:
    """Condition and parameters as one name; also of what has these two of a trial."""
    swept = ",".join(f"{name}={value}" for name, value in sorted(trial["parameters"].items()))
    return f"{trial['condition']}[{swept}]" if swept else str(trial["condition"])


def _place(row: Row, order: Sequence[str]) -> tuple[Any, ...]:
    condition = row.trial["condition"]
    known = order.index(condition) if condition in order else len(order)
    return bool(row.trial["fault"]), known, condition, *rank(row.trial["parameters"])


def rank(parameters: Mapping[str, Any]) -> tuple[Any, ...]:
    """Parameters as something to sort by: numbers by size, before words."""
    return tuple(
        (name, 0, value, "") if number(value) else (name, 1, 0, str(value))
        for name, value in sorted(parameters.items())
    )


def number(value: object) -> bool:
    """Whether a parameter's value is a number; true and false are words."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def _invalid(rows: Sequence[Row]) -> Document:
    runs = [
        {
            "id": row.id,
            "condition": row.trial["condition"],
            "parameters": row.trial["parameters"],
            "lap": lap_name(row.trial["lap"]),
            "reason": row.result["reason"],
        }
        for row in rows
        if row.result["outcome"] == "INVALID"
    ]
    return {"n": len(runs), "runs": runs}


def _head(key: str, group: Sequence[Row]) -> Document:
    n = len(valid(group))
    return {
        "key": key,
        "condition": group[0].trial["condition"],
        "parameters": dict(sorted(group[0].trial["parameters"].items())),
        "invalid": len(group) - n,
        "n": n,
    }


def _condition(key: str, group: Sequence[Row], ftti_s: float | None) -> Document:
    runs = valid(group)
    counts = {outcome: count(runs, outcome) for outcome in OUTCOMES}
    td = times([row.result["td_ns"] for row in runs if row.result["outcome"] == "CD"])
    # What was not found correctly took longer than any time that was seen.
    every = [*td.values_s, *[math.inf] * (len(runs) - len(td.values_s))]
    return {
        **_head(key, group),
        **counts,
        "rates": {outcome: rate(hits, len(runs)) for outcome, hits in counts.items()},
        "coverage": finite(Rate(counts["CD"], len(runs)).supported),
        "td_s": {
            "n": len(td.values_s),
            "mean": finite(td.mean),
            "sigma": finite(td.deviation),
            "median": finite(td.median),
            "p95": finite(td.percentile(95)),
            "max": finite(td.longest),
            "censored": counts["MD"],
            "median_of_all": finite(middle(every)),
        },
        "named": _named(runs),
        "ftti": _ftti(runs, td, ftti_s),
    }


def _named(runs: Sequence[Row]) -> Document:
    """Of the alarms in time that named a kind, how many named the right one."""
    judged = [
        row.result["named"] == expected_kind(row.trial["fault"])
        for row in runs
        if row.result["outcome"] in ("CD", "ID")
        and row.result["named"] is not None
        and expected_kind(row.trial["fault"]) is not None
    ]
    return {"right": sum(judged), "n": len(judged), **rate(sum(judged), len(judged))}


def _ftti(runs: Sequence[Row], td: Times, ftti_s: float | None) -> Document | None:
    """What detection leaves of the fault tolerant time interval to the reaction (FHTI = FDTI + FRTI)."""
    own = [row.trial["ftti_s"] for row in runs if row.trial["ftti_s"] is not None]
    limit = min(own, default=None) if ftti_s is None else ftti_s
    if limit is None:
        return None
    beyond = sum(value > limit for value in td.values_s) + count(runs, "MD")
    return {
        "ftti_s": limit,
        "margin_p95_s": finite(limit - td.percentile(95)),
        "margin_max_s": finite(limit - td.longest),
        "beyond": beyond,
    }


def _fault_free(key: str, group: Sequence[Row]) -> Document:
    laps = valid(group)
    hours = sum(row.result["ridden_ns"] for row in laps) / 3.6e12
    alarms = sum(row.result["alarms"] for row in laps)
    false = count(laps, "FA")
    return {
        **_head(key, group),
        "OK": count(laps, "OK"),
        "FA": false,
        "rates": {"FA": rate(false, len(laps))},
        "hours": hours,
        "alarms": alarms,
        "alarms_per_h_at_most": finite(alarm_rate_bound(alarms, hours)),
    }


def _steps(rows: Iterable[Row]) -> list[Document]:
    """Time of one step of the ECU, us by its clock, of every ECU that has one."""
    groups: dict[tuple[str, str, int], list[Document]] = {}
    for row in valid(rows):
        steps, ecu = row.result["steps"], row.trial["ecu"]
        if steps["hz"] and steps["n"]:
            groups.setdefault((ecu["ecu"], ecu["runs_on"], steps["hz"]), []).append(steps)
    found = []
    for (name, runs_on, hz), steps in sorted(groups.items()):
        sums = [sum(each[field] for each in steps) for field in ("n", "cycles", "squares")]
        mean, sigma = mean_and_deviation(*sums)
        extremes = min(each["least"] for each in steps), max(each["most"] for each in steps)
        us = [finite(cycles * 1e6 / hz) for cycles in (mean, sigma, *extremes)]
        key = f"{name} on {runs_on}, {hz / 1e6:g} MHz"
        found.append(
            {"key": key, "ecu": name, "runs_on": runs_on, "hz": hz, "n": sums[0]}
            | dict(zip(("mean_us", "sigma_us", "min_us", "max_us"), us, strict=True))
        )
    return found
