"""Commands to a running replay, one JSON object a line, and their answers. Sans-I/O.

`{"do": "fire", "fault": "rear_stroke:open+2"}` -> `{"t_s": 12.3, "number": 0, "faults": [...]}`, or
`{"error": "..."}`. Belongs here: what a line means. Never: the socket it came by, what a fault does.
"""

import json
from typing import Any

from bench.errors import BenchError, FaultError
from bench.faults.spec import FaultSpec, parse_fault
from bench.panel import Entry, Panel

LONGEST = 4096
"""Bytes of a line."""

VERBS = ("arm", "fire", "clear", "list")


def answer(line: bytes, panel: Panel, t_ns: int) -> bytes:
    """Do what `line` asks of `panel` at bench time `t_ns`; the answer, a line without its end.

    `fire` takes a fault or the number of an armed one, `clear` a number or nothing: all that can be cleared.
    """
    try:
        number = _do(_request(line), panel, t_ns)
        rows = [_row(entry) for entry in panel.entries(t_ns)]
        reply: dict[str, Any] = {"t_s": t_ns / 1e9, "number": number, "faults": rows}
    except BenchError as error:
        reply = {"error": f"{error.side}: {error}"}
    return json.dumps(reply).encode()


def parse_command(text: str) -> FaultSpec:
    """A fault as it is armed or fired: `SENSOR:KIND[:PARAM=VALUE,...][@now[+DURATION]]`.

    Raises FaultError.
    """
    head, at, when = text.partition("@")
    if not at:
        return parse_fault(f"{head}@0")
    if not when.startswith("now"):
        raise FaultError(f"{text!r}: a running replay fires @now, or leaves the time out")
    return parse_fault(f"{head}@0{when.removeprefix('now')}")


def _request(line: bytes) -> dict[str, Any]:
    try:
        request = json.loads(line)
    except (ValueError, RecursionError):
        raise FaultError(f"{line[:60]!r} is no JSON") from None
    if not isinstance(request, dict) or request.get("do") not in VERBS:
        raise FaultError(f"{line[:60]!r} asks for none of {', '.join(VERBS)}")
    return request


def _do(request: dict[str, Any], panel: Panel, t_ns: int) -> int | None:
    verb, fault = request["do"], request.get("fault")
    if verb == "list":
        return None
    if verb == "clear":
        return _clear(fault, panel, t_ns)
    if isinstance(fault, str):
        number = panel.arm(parse_command(fault))
    elif verb == "fire":
        number = _number(fault)
    else:
        raise FaultError(f"{fault!r} is no fault to arm")
    if verb == "fire":
        panel.fire(number, t_ns)
    return number


def _clear(fault: Any, panel: Panel, t_ns: int) -> int | None:
    if fault is not None:
        number = _number(fault)
        panel.clear(number, t_ns)
        return number
    clearable = panel.clearable(t_ns)
    if not clearable:
        raise FaultError("no fault is active: nothing to clear")
    for number in clearable:
        panel.clear(number, t_ns)
    return clearable[-1]


def _number(fault: Any) -> int:
    if isinstance(fault, bool) or not isinstance(fault, int):
        raise FaultError(f"{fault!r} is no number of a fault")
    return fault


def _row(entry: Entry) -> dict[str, Any]:
    row: dict[str, Any] = {"number": entry.number, "state": str(entry.state)}
    known = entry.insertion
    if known is None:
        return row | {"spec": str(entry.spec).partition("@")[0]}
    instants = {"t_cmd_s": known.t_cmd_ns, "t_active_s": known.t_active_ns, "t_end_s": known.t_end_ns}
    seconds = {name: None if ns is None else ns / 1e9 for name, ns in instants.items()}
    return row | {"spec": str(entry.spec), **seconds}
