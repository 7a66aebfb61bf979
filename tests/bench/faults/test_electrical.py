"""The kinds of a potentiometer's wiring: their laws on counts, and how they agree with each other."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.faults.insertion import insert
from bench.faults.spec import parse_fault
from bench.sensors.codes import Codes
from bench.sensors.network import PULL_OHM, TRACK_OHM

EVERY = np.arange(4096, dtype=np.int32)
X = EVERY / 4095.0


def faulty(text, codes=EVERY, other=None):
    """The codes of both strokes under a fault from the start."""
    other = codes if other is None else other
    t_ns = np.arange(len(codes)) * 1_000_000
    both = Codes(
        t_ns, {"rear_stroke": np.asarray(codes, np.int32), "fork_stroke": np.asarray(other, np.int32)}
    )
    return insert(both, [parse_fault(f"rear_stroke:{text}@0")])[0].codes


def rear(text):
    return faulty(text)["rear_stroke"]


@pytest.mark.parametrize(
    "text",
    [
        *(f"series_resistance:ohm=0,wire={wire},pull={pull}" for wire in ("supply", "ground", "signal")
          for pull in ("up", "down")),
        *(f"ground_shift:by=0,pull={pull}" for pull in ("up", "down")),
        *(f"leakage:ohm=1e9,to={to}" for to in ("gnd", "batt", "supply")),
    ],
)  # fmt: skip
def test_a_fault_of_no_size_changes_no_code(text):
    """Through the healthy circuit and back every code is the same, whichever way the pin is pulled."""
    assert np.array_equal(rear(text), EVERY)


def test_shorts():
    """Shorted to ground every code is zero, to the battery the full scale."""
    assert not rear("short_gnd").any()
    assert set(rear("short_batt")) == {4095}
    assert set(rear("short_pin:to=supply")) == {4095}


@pytest.mark.parametrize(("to", "short"), [("gnd", "short_gnd"), ("batt", "short_batt")])
def test_a_short_is_a_leak_of_no_resistance(to, short):
    """The smaller the leak's resistance, the nearer the codes are to the short's; at zero they are its."""
    law = rear(short)
    errors = [np.abs(rear(f"leakage:ohm={ohm},to={to}") - law).max() for ohm in (1e6, 1e4, 100, 1, 0)]
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] == 0
    assert np.array_equal(rear("short:to=gnd" if to == "gnd" else "short:to=batt"), law)


@pytest.mark.parametrize(("pull", "reads"), [("up", 4095), ("down", 0)])
def test_an_open_signal_reads_the_pull(pull, reads):
    """The larger the resistance in the signal's wire, the nearer the code is to the pull's."""
    errors = [
        np.abs(rear(f"series_resistance:ohm={ohm},wire=signal,pull={pull}") - reads).max()
        for ohm in (0, 1e5, 1e6, 1e7, 1e9)
    ]
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] <= 5
    if pull == "up":
        assert np.array_equal(rear("open"), np.full(4096, reads))


def test_resistance_in_the_supply_is_a_gain():
    """With R in the supply's wire the range shrinks to track / (track + R), but for what the pull adds."""
    gain = TRACK_OHM / (TRACK_OHM + 500.0)
    assert np.abs(rear("series_resistance:ohm=500") - gain * EVERY).max() <= 4095 * 0.003
    assert rear("series_resistance:ohm=500")[0] == 0


def test_resistance_in_the_ground_lifts_the_foot():
    """With R in the ground's wire zero reads R / (track + R), and the full scale stays."""
    codes = rear("series_resistance:ohm=500,wire=ground")
    assert codes[0] == pytest.approx(4095 * 500 / 5500, abs=6)
    assert codes[-1] == 4095
    assert (np.diff(codes) >= 0).all()


def test_leak_by_kirchhoff():
    """At every slider place the currents into the pin add up to zero, within a code's rounding."""
    v = rear("leakage:ohm=3000,to=gnd") / 4095.0
    # the slider's place from the healthy voltage, by bisection on its own balance of currents
    low, high = np.zeros(4096), np.ones(4096)
    for _ in range(60):
        x = (low + high) / 2
        into = balance(X, x)
        low, high = np.where(into > 0, low, x), np.where(into > 0, x, high)
    # a code of rounding is a current through all that hangs on the pin
    conductance = 1 / np.maximum(x * (1 - x) * TRACK_OHM, 1e-3) + 1 / PULL_OHM + 1 / 3000
    assert (np.abs(balance(v, x) - v / 3000) <= 0.51 / 4095 * conductance).all()


def balance(v, x):
    """Current into the pin at voltage `v` from track and pull, shares of the reference per ohm."""
    ohm = np.maximum(x * (1 - x) * TRACK_OHM, 1e-3)
    return (x - v) / ohm + (1 - v) / PULL_OHM


@given(st.floats(-1, 1), st.integers(0, 4095))
def test_ground_shift(volts, code):
    """A ground raised by V lifts a code by V times what is left to the supply, saturated."""
    found = faulty(f"ground_shift:by={volts!r}", [code, code])["rear_stroke"][0]
    assert found == pytest.approx(np.clip(code + volts / 5 * (4095 - code), 0, 4095), abs=8)


@given(st.integers(0, 4095), st.integers(0, 4095))
def test_bridged_pins_read_alike(code, other):
    """Two bridged signals read one voltage, between those they had; twice the same slider changes nothing."""
    both = faulty("short_pin", [code, code], [other, other])
    assert both["rear_stroke"].tolist() == both["fork_stroke"].tolist()
    assert min(code, other) <= both["rear_stroke"][0] <= max(code, other)
    if code == other:
        assert both["rear_stroke"][0] == code


def test_bridge_weighs_by_resistance():
    """A slider near the end of its track holds its voltage against one in the middle."""
    both = faulty("short_pin", [4000, 4000], [2048, 2048])
    # Thevenin: x (1-x) track; the end's is the smaller, the mean lies near it
    here, there = (4000 / 4095) * (95 / 4095), 0.25
    law = (4000 * there + 2048 * here) / (here + there)
    assert both["rear_stroke"][0] == pytest.approx(law, abs=6)


@given(
    st.sampled_from(("series_resistance", "leakage")),
    st.floats(0, 1e6),
    st.floats(0, 1e6),
    st.sampled_from(("up", "down")),
)
def test_more_of_a_fault_moves_further(kind, ohm, more, pull):
    """More resistance in the supply, or less to ground, never raises a code."""
    less, larger = sorted((ohm, more))
    far, near = (larger, less) if kind == "series_resistance" else (less, larger)
    further = rear(f"{kind}:ohm={far!r},pull={pull}")
    assert (further <= rear(f"{kind}:ohm={near!r},pull={pull}")).all()
