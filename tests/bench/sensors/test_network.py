"""The circuit of a stroke potentiometer: the healthy way there and back, and its limits."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.sensors.network import PULL_OHM, TRACK_OHM, Network, joined

EVERY = np.arange(4096) / 4095.0
PULLS = pytest.mark.parametrize("pull_to", [0.0, 0.5, 1.0])


@PULLS
def test_there_and_back(pull_to):
    """The slider's place found from a voltage gives that voltage again, for every code."""
    network = Network(pull_to=pull_to)
    assert np.abs(network.pin(network.slider(EVERY)) - EVERY).max() < 1e-12


@PULLS
def test_the_pull_bends_a_healthy_line_a_little(pull_to):
    """A quarter of track over pull at the middle of the track: 0.13 % of the range at most."""
    bent = np.abs(Network(pull_to=pull_to).pin(EVERY) - EVERY).max()
    assert bent <= 0.25 * TRACK_OHM / PULL_OHM
    assert bent > 0


@given(st.floats(0, 1), st.floats(0, 1e6), st.floats(0, 1e6), st.floats(0, 1e6), st.floats(-0.5, 0.5))
def test_the_wiper_by_nodes(x, supply, ground, signal, shift):
    """Thevenin's voltage and resistance are those of the two branches, written as conductances."""
    above, below = (1 - x) * TRACK_OHM + supply, x * TRACK_OHM + ground
    v, ohm = Network(supply_ohm=supply, ground_ohm=ground, ground=shift).wiper(np.array([x]))
    if above > 1e-6 and below > 1e-6:
        assert v[0] == pytest.approx((1 / above + shift / below) / (1 / above + 1 / below), abs=1e-9)
        assert ohm[0] == pytest.approx(1 / (1 / above + 1 / below), rel=1e-9, abs=1e-9)
    pin = Network(supply_ohm=supply, ground_ohm=ground, ground=shift, signal_ohm=signal).pin(np.array([x]))
    assert min(v[0], 1.0) - 1e-9 <= pin[0] <= 1.0 + 1e-9


def test_an_open_wire_leaves_the_pull():
    """Without a wire to the slider the pin is where it is pulled, whatever the slider does."""
    for pull_to in (0.0, 1.0):
        assert set(Network(pull_to=pull_to, signal_ohm=math.inf).pin(EVERY)) == {pull_to}


def test_sources_on_one_node():
    """Two sources share by conductance; one of no ohms wins, of two the second; an infinite one is none."""
    one = np.array([1.0])
    v, ohm = joined(one, 3 * one, 0.0, 1.0)
    assert (v[0], ohm[0]) == (0.25, 0.75)
    assert joined(one, 3 * one, 0.5, 0.0)[0][0] == 0.5
    assert joined(one, 0 * one, 0.5, 3.0)[0][0] == 1.0
    assert joined(one, 0 * one, 0.5, 0.0)[0][0] == 0.5
    assert joined(one, 3 * one, 0.5, math.inf)[1][0] == 3.0
