"""The catalogue as a whole: what every row has, names and failure type bytes."""

import json

import numpy as np
import pytest

from bench.codec import Codec
from bench.errors import FaultError
from bench.faults.catalogue import catalogue
from bench.faults.example import example
from bench.faults.ftb import FTB
from bench.faults.kinds import KINDS, Number
from bench.faults.spec import parse_fault

DESIGN = (
    *("open", "short", "hold", "uncalibration", "short_gnd", "short_batt", "short_pin", "series_resistance"),
    *("leakage", "loose_contact", "ground_shift", "drift", "offset", "noise", "spike", "delay", "slow"),
    *("frame_loss", "frame_corruption", "frame_repeat", "stuck_counter", "babbling", "bus_off"),
)


def test_every_kind_of_the_design():
    """The catalogue has the thesis's four and every kind beyond them, each once."""
    assert sorted(KINDS) == sorted(DESIGN)


def test_bytes_and_names():
    """Every byte used is in the table, every byte of the table used; names are those an ECU can send."""
    words = set(Codec().message("IFD_STATUS").signals["kind"].names.values()) - {"none"}
    used = set()
    for name in KINDS:
        for head in (f"{name}:to=batt", f"{name}:to=supply", name):
            try:
                spec = example(head).spec
            except FaultError:
                continue
            used.add(spec.ftb)
            assert spec.called is None or spec.called in words
    assert used - {None} == set(FTB)


@pytest.mark.parametrize(
    ("text", "called", "ftb"),
    [
        ("speed:open@0", "open", 0x13),
        ("speed:short@0", "short", 0x11),
        ("speed:short:to=batt@0", "open", 0x12),
        ("rear_stroke:short_gnd@0", "short", 0x11),
        ("rear_stroke:short_batt@0", "open", 0x12),
        ("rear_stroke:short_pin@0", None, 0x2B),
        ("rear_stroke:short_pin:to=supply@0", "open", 0x12),
        ("rear_stroke:leakage@0", "uncalibration", 0x1A),
        ("speed:drift@0", "uncalibration", 0x28),
        ("speed:loose_contact@0", None, 0x1F),
        ("speed:delay@0", None, None),
        ("bus:bus_off@0", None, 0x88),
    ],
)
def test_what_a_fault_is_called(text, called, ftb):
    """A fault's name for a detector and its failure type byte follow its kind and parameters."""
    assert (parse_fault(text).called, parse_fault(text).ftb) == (called, ftb)


def test_defaults_lie_in_their_ranges():
    """A kind written without parameters is a fault that can be."""
    for kind in KINDS.values():
        for rule in kind.params.values():
            assert not isinstance(rule, Number) or rule.low <= rule.default <= rule.high


@pytest.mark.parametrize("name", DESIGN)
def test_every_kind_has_its_picture(name):
    """The example of each kind shows a trace that differs from the healthy one only from the fault on."""
    shown = example(name)
    pairs = [
        (trace, trace.replace("_healthy_", "_faulty_")) for trace in shown.traces if "_healthy_" in trace
    ]
    assert 2 * len(pairs) == len(shown.traces)
    # frames are counted in tenths of a second
    before = shown.t_s < shown.spec.t_cmd_ns / 1e9 - 0.1
    for healthy, faulty in pairs:
        assert np.isfinite(shown.traces[faulty]).all()
        assert np.array_equal(shown.traces[healthy][before], shown.traces[faulty][before])
    assert any(not np.array_equal(shown.traces[healthy], shown.traces[faulty]) for healthy, faulty in pairs)


def test_a_fault_without_effect_still_has_a_picture():
    """Where nothing changes, the picture shows just that."""
    assert example("frame_loss:rate=0", "MOTION").traces
    assert example("offset:by=0", "speed").traces


def test_as_json():
    """The catalogue goes into JSON and back, parameters with default and range or words."""
    rows = {row["kind"]: row for row in json.loads(json.dumps(catalogue()))}
    assert list(rows) == list(KINDS)
    assert rows["leakage"]["parameters"][:2] == [
        {"name": "ohm", "default": 10000.0, "low": 0.0, "high": 1e9, "unit": "ohm"},
        {"name": "to", "default": "gnd", "options": ["gnd", "batt", "supply"]},
    ]
    assert rows["hold"]["failure_type"] == {
        "byte": "0x2A",
        "text": "signal stuck in range",
        "confirmed": False,
    }
    assert rows["babbling"]["places"] == ["bus"]
    assert rows["babbling"]["failure_type"] is None
