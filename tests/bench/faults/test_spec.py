"""The written form of a fault: what it reads as, that it writes back, and what it refuses."""

import re
from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.errors import FaultError
from bench.faults.kinds import KINDS, Choice
from bench.faults.spec import FaultSpec, parse_fault
from bench.sensors.transducers import TRANSDUCERS


@st.composite
def specs(draw):
    kind = draw(st.sampled_from(sorted(KINDS)))
    params = {
        name: draw(
            st.sampled_from(rule.options) if isinstance(rule, Choice) else st.floats(rule.low, rule.high)
        )
        for name, rule in KINDS[kind].params.items()
    }
    return FaultSpec(
        draw(st.sampled_from(sorted(TRANSDUCERS))),
        kind,
        tuple(params.items()),
        draw(st.integers(0, 10**17)),
        draw(st.none() | st.integers(1, 10**17)),
    )


@given(specs())
def test_round_trip(spec):
    """A fault written out reads back as the same fault."""
    assert parse_fault(str(spec)) == spec


@pytest.mark.parametrize(
    ("text", "spec"),
    [
        (
            "rear_stroke:uncalibration:gain=1.25@120",
            FaultSpec("rear_stroke", "uncalibration", (("gain", 1.25),), 120_000_000_000),
        ),
        ("rear_stroke:open@60+5", FaultSpec("rear_stroke", "open", (), 60_000_000_000, 5_000_000_000)),
        ("speed:short:to=batt@0.000000001", FaultSpec("speed", "short", (("to", "batt"),), 1)),
        ("fork_stroke:hold@1.5+0.25", FaultSpec("fork_stroke", "hold", (), 1_500_000_000, 250_000_000)),
    ],
)
def test_examples(text, spec):
    """The documented forms read as what they say, times exact to the nanosecond."""
    assert parse_fault(text) == spec
    assert str(spec) == text


def test_defaults_are_filled_in():
    """A fault without its parameters is the same fault as one with their defaults written out."""
    assert parse_fault("rear_stroke:uncalibration@1") == parse_fault("rear_stroke:uncalibration:gain=1.1@1")
    assert parse_fault("rear_stroke:short@1") == parse_fault("rear_stroke:short:to=gnd@1")


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("rear:open@1", "unknown sensor 'rear'; the known ones are fork_stroke, rear_stroke"),
        ("rear_stroke:melt@1", "unknown kind 'melt'; the known ones are open, short"),
        ("rear_stroke@1", "unknown kind ''"),
        ("rear_stroke:uncalibration:slope=2@1", "unknown parameter 'slope'; uncalibration takes gain"),
        ("rear_stroke:open:gain=2@1", "unknown parameter 'gain'; open takes no parameter"),
        ("rear_stroke:uncalibration:gain=1,gain=2@1", "'gain' of uncalibration is given twice"),
        ("rear_stroke:uncalibration:gain=much@1", "gain=much is not a number"),
        ("rear_stroke:uncalibration:gain=nan@1", "gain=nan is not a number"),
        ("rear_stroke:uncalibration:gain=inf@1", "gain=inf is not a number"),
        ("rear_stroke:uncalibration:gain=1_1@1", "gain=1_1 is not a number"),
        ("rear_stroke:uncalibration:gain=1e999@1", "gain=1e999 is not within 0 to 10"),
        ("rear_stroke:uncalibration:gain=-1@1", "gain=-1 is not within 0 to 10"),
        ("rear_stroke:short:to=moon@1", "to=moon is not one of gnd, batt"),
        (
            "rear_stroke:uncalibration:gain@1",
            "'gain' in 'rear_stroke:uncalibration:gain@1' is not PARAM=VALUE",
        ),
        ("rear_stroke:open:@1", "'' in 'rear_stroke:open:@1' is not PARAM=VALUE"),
        ("rear_stroke:open", "'rear_stroke:open' has no @TIME"),
        ("rear_stroke:open@", "time ''"),
        ("rear_stroke:open@-1", "time '-1'"),
        ("rear_stroke:open@nan", "time 'nan'"),
        ("rear_stroke:open@1e3", "time '1e3'"),
        ("rear_stroke:open@0.0000000001", "time '0.0000000001'"),
        ("rear_stroke:open@1@2", "time '1@2'"),
        ("rear_stroke:open@1+", "duration ''"),
        ("rear_stroke:open@1+0", "duration 0 ns is not positive"),
        ("rear_stroke:open@1+-2", "duration '-2'"),
        ("", "has no @TIME"),
    ],
)
def test_refused(text, says):
    """A fault that cannot be is refused in one line that names the value at fault."""
    with pytest.raises(FaultError, match=re.escape(says)) as refusal:
        parse_fault(text)
    assert "\n" not in str(refusal.value)


@given(st.text(alphabet="rear_stokpnholdg:@+=,.-019 \n\u0661", max_size=40))
def test_any_text(text):
    """Whatever the text, it is a fault or a FaultError, never another failure."""
    with suppress(FaultError):
        assert parse_fault(str(parse_fault(text))) == parse_fault(text)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("speed", "open", (), -1), "time -1 ns"),
        (("speed", "open", (), 0, 0), "duration 0 ns"),
        (("speed", "uncalibration", (("gain", float("nan")),)), "gain=nan is not within"),
    ],
)
def test_built_in_code(arguments, says):
    """A fault built in code passes the same checks as a written one."""
    with pytest.raises(FaultError, match=says):
        FaultSpec(*arguments)
