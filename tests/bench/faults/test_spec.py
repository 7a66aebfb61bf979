"""The written form of a fault: what it reads as, that it writes back, and what it refuses."""

import re
from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.errors import FaultError
from bench.faults.kinds import KINDS, Choice
from bench.faults.places import places
from bench.faults.spec import FaultSpec, parse_fault
from bench.faults.trigger import Random, Sector, When
from dbc import CHANNELS


def values(rule):
    """What a parameter may be."""
    if isinstance(rule, Choice):
        return st.sampled_from(rule.options)
    return st.integers(int(rule.low), int(rule.high)) if rule.whole else st.floats(rule.low, rule.high)


NS = st.integers(0, 10**17)
WHENS = st.builds(
    When, st.sampled_from(CHANNELS), st.sampled_from((">", "<", ">=", "<=")), st.floats(-1e6, 1e6), NS
)
SECTORS = st.integers(1, 10_000).flatmap(lambda of: st.builds(Sector, st.integers(1, of), st.just(of)))
RANDOMS = st.builds(
    lambda low, more, seed: Random(low, low + more, seed),
    NS,
    st.integers(1, 10**17),
    st.integers(0, 2**32 - 1),
)


@st.composite
def specs(draw):
    kind = draw(st.sampled_from(sorted(KINDS)))
    params = {name: draw(values(rule)) for name, rule in KINDS[kind].params.items()}
    start = draw(st.none() | WHENS | SECTORS | RANDOMS)
    until = draw(st.none() | WHENS)
    return FaultSpec(
        draw(st.sampled_from(places(KINDS[kind].where))),
        kind,
        tuple(params.items()),
        0 if start else draw(NS),
        None if until else draw(st.none() | st.integers(1, 10**17)),
        start,
        until,
    )


@given(specs())
def test_round_trip(spec):
    """A fault written out reads back as the same fault."""
    assert parse_fault(str(spec)) == spec


BABBLE = (("rate", 500.0), ("id", 1.0), ("length", 0.0))


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
        ("bus:babbling:rate=500,id=1,length=0@2", FaultSpec("bus", "babbling", BABBLE, 2_000_000_000)),
        ("speed:open@sector=3/8+2", FaultSpec("speed", "open", (), 0, 2_000_000_000, Sector(3, 8))),
        (
            "STROKES:stuck_counter@when=speed_kmh>80,for=0.5+when=speed_kmh<=-2.5",
            FaultSpec(
                "STROKES",
                "stuck_counter",
                start=When("speed_kmh", ">", 80.0, 500_000_000),
                until=When("speed_kmh", "<=", -2.5),
            ),
        ),
        (
            "speed:open@random=20..120.5,seed=7",
            FaultSpec("speed", "open", start=Random(20_000_000_000, 120_500_000_000, 7)),
        ),
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
        ("rear:open@1", "unknown sensor 'rear'; did you mean rear_stroke? The known ones are fork_stroke"),
        (
            "rear_strok:open@1",
            "unknown sensor 'rear_strok'; did you mean rear_stroke? The known ones are fork",
        ),
        ("IFD_STATUS:frame_loss@1", "unknown sensor 'IFD_STATUS'; the known ones are fork_stroke"),
        ("rear_stroke:melt@1", "unknown kind 'melt'; the known ones are open, short"),
        ("rear_stroke:opne@1", "unknown kind 'opne'; did you mean open? The known ones are open, short"),
        ("STROKES:frame_los@1", "did you mean frame_loss? The known ones are frame_loss, frame_corruption"),
        (
            "speed:leakage@1",
            "speed:leakage: leakage acts on a stroke potentiometer, not on speed; write fork_s",
        ),
        ("STROKES:open@1", "STROKES:open: open acts on a sensor, not on STROKES; write fork_stroke"),
        ("STROKES:bus_off@1", "STROKES:bus_off: bus_off acts on bus, not on STROKES; write bus"),
        (
            "speed:frame_loss@1",
            "frame_loss acts on a message of the logger, or bus for all of them, not on spe",
        ),
        ("speed:noise:seed=0.5@1", "noise:seed=0.5 is not a whole number"),
        ("speed:noise:seed=-1@1", "noise:seed=-1 is not within 0 to 4.29497e+09"),
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
        ("speed:open@sector=3", "sector '3' in 'speed:open@sector=3' is not K/N"),
        ("speed:open@sector=x/8", "sector 'x/8'"),
        ("speed:open@sector=0/8", "sector=0/8: the sectors are 1 to 8"),
        ("speed:open@sector=9/8", "sector=9/8: the sectors are 1 to 8"),
        ("speed:open@sector=1/0", "sector=1/0: a lap has 1 to 10000 sectors"),
        ("speed:open@sector=1/99999", "a lap has 1 to 10000 sectors"),
        ("speed:open@when=speed>1", "unknown channel 'speed'; did you mean speed_kmh?"),
        (
            "speed:open@when=speed_kmh=1",
            "condition 'speed_kmh=1' in 'speed:open@when=speed_kmh=1' is not CHA",
        ),
        ("speed:open@when=speed_kmh>", "value ''"),
        ("speed:open@when=speed_kmh>fast", "value 'fast'"),
        ("speed:open@when=speed_kmh>1e3", "value '1e3'"),
        ("speed:open@when=speed_kmh>2000000", "beyond 1e+06"),
        ("speed:open@when=speed_kmh>1,for=-1", "for '-1'"),
        ("speed:open@when=speed_kmh>1,four=1", "'four=1' in"),
        (
            "speed:open@when=speed_kmh>1,for=1,for=2",
            "for in 'speed:open@when=speed_kmh>1,for=1,for=2' is give",
        ),
        ("speed:open@random=5", "window '5'"),
        ("speed:open@random=5..5", "random=5..5: the second instant must come after the first"),
        ("speed:open@random=5..4", "the second instant must come after the first"),
        ("speed:open@random=..4", "time ''"),
        ("speed:open@random=1..4,seed=x", "seed 'x'"),
        ("speed:open@random=1..4,seed=9999999999", "a seed is 0 to 4294967295"),
        (
            "speed:open@1+sector=1/2",
            "'sector=1/2' in 'speed:open@1+sector=1/2': a fault ends after a duration",
        ),
        ("speed:open@1+when=", "condition '' in"),
        ("speed:open@soon=1", "time 'soon=1'"),
        ("", "has no @TIME"),
    ],
)
def test_refused(text, says):
    """A fault that cannot be is refused in one line that names the value at fault."""
    with pytest.raises(FaultError, match=re.escape(says)) as refusal:
        parse_fault(text)
    assert "\n" not in str(refusal.value)


@given(st.text(alphabet="rear_stokpnholdgcw:@+=,.-/<>019 \n\u0661", max_size=40))
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
        (("speed", "open", (), 5, None, Sector(1, 2)), "begins at 5 ns and on sector=1/2; it can have one"),
        (("speed", "open", (), 5, 5, None, When("speed_kmh", ">", 1.0)), "ends after 5 ns and on when=speed"),
    ],
)
def test_built_in_code(arguments, says):
    """A fault built in code passes the same checks as a written one."""
    with pytest.raises(FaultError, match=says):
        FaultSpec(*arguments)


@given(
    st.sampled_from(("sector=", "when=", "random=")),
    st.text(alphabet="speed_kmhfor=,.-/<>019 x", max_size=20),
)
def test_any_trigger(name, text):
    """Whatever stands behind a trigger's name, it is a trigger or a FaultError."""
    with suppress(FaultError):
        spec = parse_fault(f"speed:open@{name}{text}")
        assert not spec.resolved
        assert parse_fault(str(spec)) == spec


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ((When, "speed_kmh", "=", 1.0), "comparison '=' is none of"),
        ((When, "speed_kmh", ">", float("nan")), "beyond 1e"),
        ((When, "speed_kmh", ">", 1.0, -1), "for -1 ns is below zero"),
        ((Random, -1, 5), "the second instant must come after the first"),
    ],
)
def test_trigger_built_in_code(arguments, says):
    """A trigger built in code passes the same checks as a written one."""
    kind, *values = arguments
    with pytest.raises(FaultError, match=says):
        kind(*values)
