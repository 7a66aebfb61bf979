"""Commands to a running replay: what a line means and what it answers."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.codec import Codec
from bench.control import answer
from bench.panel import Panel
from bench.script import Script
from bench.sensors.codes import acquire
from tests.conftest import wavy_lap

MS = 1_000_000
CODES = acquire(wavy_lap(0.5))


def panel():
    return Panel(Script(CODES, Codec()))


def ask(on, t_ns, **request):
    return json.loads(answer(json.dumps(request).encode(), on, t_ns))


def test_fire_and_clear():
    """A fault fired and cleared by lines is on the panel with its instants."""
    on = panel()
    assert ask(on, 100 * MS, do="fire", fault="rear_stroke:open")["number"] == 0
    row = ask(on, 150 * MS, do="list")["faults"][0]
    assert (row["state"], row["t_active_s"], row["t_end_s"]) == ("active", 0.1, None)
    reply = ask(on, 200 * MS, do="clear")
    assert reply["faults"][0] == {
        "number": 0,
        "state": "cleared",
        "spec": "rear_stroke:open@0.1+0.1",
        "t_cmd_s": 0.1,
        "t_active_s": 0.1,
        "t_end_s": 0.2,
    }


def test_armed_then_fired_by_number():
    """An armed fault has no instants; fired by its number it has."""
    on = panel()
    reply = ask(on, 0, do="arm", fault="rear_stroke:hold@now+0.1")
    assert reply["faults"] == [{"number": 0, "state": "armed", "spec": "rear_stroke:hold"}]
    reply = ask(on, 50 * MS, do="fire", fault=0)
    assert reply["faults"][0]["spec"] == "rear_stroke:hold@0.05+0.1"


@pytest.mark.parametrize(
    ("line", "says"),
    [
        (b"", "fault: b'' is no JSON"),
        (b"[]", "fault: b'[]' asks for none of arm, fire, clear, list"),
        (b'{"do": "eat"}', "asks for none of"),
        (b'{"do": "fire"}', "None is no number of a fault"),
        (b'{"do": "fire", "fault": true}', "True is no number of a fault"),
        (b'{"do": "arm", "fault": 3}', "3 is no fault to arm"),
        (b'{"do": "fire", "fault": "rear_stroke:open@60"}', "fires @now, or leaves the time out"),
        (b'{"do": "fire", "fault": "tail:open"}', "unknown sensor 'tail'"),
        (b'{"do": "clear"}', "no fault is active: nothing to clear"),
        (b'{"do": "clear", "fault": 0}', "no fault 0 on the panel; there are none"),
        (b"[" * 4000, "is no JSON"),
    ],
)
def test_refused(line, says):
    """What cannot be done is answered with one line that says why."""
    assert says in json.loads(answer(line, panel(), 0))["error"]


@given(st.binary(max_size=200))
def test_any_line_is_answered(line):
    """Whatever comes, the answer is one line of JSON."""
    reply = answer(line, panel(), 0)
    assert b"\n" not in reply
    json.loads(reply)
