"""A campaign as JUnit XML, for what watches a continuous integration: a suite a condition, a case a trial.

Valid against Jenkins' schema (xunit plugin, junit-10.xsd). That knows no properties of a case, so td_s, the
instants and the seed stand as `name=value` lines in its system-out. `time` is the virtual time ridden, not
the time it took: same rows, same bytes.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from xml.etree import ElementTree as Xml

from campaigns.export import flat, write_text
from campaigns.outcomes import lap_name
from campaigns.store import Row

FAILED = ("MD", "FA", "ID")
SHOWN = (
    "td_s",
    "t_cmd_s",
    "t_active_s",
    "t_obs_s",
    "t_alarm_s",
    "t_heal_s",
    "named",
    "lap.seed",
    "sensors_seed",
)

_NO_XML = re.compile(r"[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""What XML 1.0 has no way to hold: most control characters, and bytes that were no text."""


def write_junit(path: Path, name: str, rows: Iterable[Row], order: Sequence[str] = ()) -> None:
    """Write the rows of campaign `name`, whole or not at all. Raises CampaignError."""
    write_text(path, junit(name, rows, order))


def junit(name: str, rows: Iterable[Row], order: Sequence[str] = ()) -> str:
    """The XML. order: conditions as they shall stand, others follow by name."""
    suites: dict[str, list[Row]] = {condition: [] for condition in order}
    for row in sorted(rows, key=lambda row: (row.trial["condition"], row.id)):
        suites.setdefault(row.trial["condition"], []).append(row)
    every = [row for suite in suites.values() for row in suite]
    root = Xml.Element("testsuites", _attributes(name, every))
    for condition, suite in suites.items():
        if suite:
            _suite(root, name, condition, suite)
    Xml.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + Xml.tostring(root, encoding="unicode") + "\n"


def _suite(root: Xml.Element, campaign: str, condition: str, rows: Sequence[Row]) -> None:
    element = Xml.SubElement(root, "testsuite", _attributes(condition, rows))
    for row in rows:
        outcome, columns = row.result["outcome"], flat(row)
        words = [row.trial["fault"] or "no fault", lap_name(row.trial["lap"])]
        words += [f"{name}={value}" for name, value in sorted(row.trial["parameters"].items())]
        attributes = {
            "name": " ".join([*words, f"({row.id})"]),
            "classname": f"{campaign}.{condition}",
            "time": _seconds([row]),
        }
        case = Xml.SubElement(element, "testcase", _plain(attributes))
        if outcome in FAILED or outcome == "INVALID":
            reason = {"type": outcome, "message": row.result["reason"]}
            Xml.SubElement(case, "failure" if outcome in FAILED else "error", _plain(reason))
        lines = [f"{name}={columns[name]}" for name in SHOWN if columns.get(name) is not None]
        Xml.SubElement(case, "system-out").text = plain("\n".join([f"outcome={outcome}", *lines]))


def _attributes(name: str, rows: Sequence[Row]) -> dict[str, str]:
    outcomes = [row.result["outcome"] for row in rows]
    return _plain(
        {
            "name": name,
            "tests": str(len(rows)),
            "failures": str(sum(outcome in FAILED for outcome in outcomes)),
            "errors": str(outcomes.count("INVALID")),
            "time": _seconds(rows),
        }
    )


def _seconds(rows: Sequence[Row]) -> str:
    return f"{sum(row.result['ridden_ns'] for row in rows) / 1e9:.3f}"


def _plain(attributes: dict[str, str]) -> dict[str, str]:
    return {name: plain(text) for name, text in attributes.items()}


def plain(text: str) -> str:
    """A text with what XML cannot hold written as an escape, as in a Python string."""
    return _NO_XML.sub(lambda match: match[0].encode("unicode_escape").decode("ascii"), text)
