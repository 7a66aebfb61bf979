"""The fault catalogue as plain data, for tables and JSON.

Belongs here: putting a row into words and numbers. Never: a row, a screen.
"""

from typing import Any

from bench.faults.ftb import FTB
from bench.faults.kind import Choice, Kind, Number
from bench.faults.kinds import KINDS
from bench.faults.places import places


def catalogue() -> list[dict[str, Any]]:
    """Every kind: kind, about, places, parameters, failure_type (of the defaults), called, thesis."""
    return [row(name) for name in KINDS]


def row(name: str) -> dict[str, Any]:
    """The row of one kind; KeyError for one that is not known."""
    kind = KINDS[name]
    defaults = {key: rule.default for key, rule in kind.params.items()}
    return {
        "kind": name,
        "about": kind.about,
        "places": list(places(kind.where)),
        "parameters": [_parameter(key, rule) for key, rule in kind.params.items()],
        "failure_type": _failure_type(kind.ftb(defaults)),
        "called": kind.called(defaults),
        "thesis": kind.thesis,
    }


def _parameter(name: str, rule: Number | Choice) -> dict[str, Any]:
    if isinstance(rule, Choice):
        return {"name": name, "default": rule.default, "options": list(rule.options)}
    whole = int if rule.whole else float
    return {
        "name": name,
        "default": whole(rule.default),
        "low": whole(rule.low),
        "high": whole(rule.high),
        "unit": rule.unit,
    }


def _failure_type(byte: int | None) -> dict[str, Any] | None:
    if byte is None:
        return None
    return {"byte": f"0x{byte:02X}", "text": FTB[byte].text, "confirmed": FTB[byte].sure}


def parameter_text(parameter: dict[str, Any]) -> str:
    """A parameter in a line: its default, and its range or the other words."""
    if "options" in parameter:
        return f"{parameter['name']}={'|'.join(parameter['options'])}"
    unit = f" {parameter['unit']}" if parameter["unit"] else ""
    low, high = (f"{parameter[end]:.10g}" for end in ("low", "high"))
    return f"{parameter['name']}={parameter['default']:g}{unit} ({low} to {high})"


def where_text(kind: Kind) -> str:
    """The class of places in a word."""
    return kind.where if kind.where != "message" else "message, bus"
