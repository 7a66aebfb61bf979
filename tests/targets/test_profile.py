"""Where a step's cycles go: nothing is lost, and it is where the sources say."""

import pytest

from targets.firmware import HERE
from targets.oscilloscope import Oscilloscope
from targets.profile import Profile
from tests.targets.test_oscilloscope import ridden


@pytest.fixture
def profile(mcu_ecu):
    """A profile of all but the first of 30 steps, and the widths of their pulses."""
    probe, counted = Oscilloscope(mcu_ecu.mcu), Profile(mcu_ecu.mcu, skip=1)
    ridden(mcu_ecu)
    return counted, probe.pulses()[1:, 0]


def test_every_cycle_is_somewhere(profile):
    """Functions, lines and instructions each add up to the pulse, give or take the blocks at its edges."""
    counted, pulses = profile
    assert counted.pulses == len(pulses) == 29
    assert counted.total == pytest.approx(pulses.mean(), abs=40)
    for sums in (counted.by_function(), counted.by_line(), counted.by_instruction()):
        assert sum(cycles for _, cycles in sums) == pytest.approx(counted.total)


def test_network_is_where_the_time_goes(profile):
    """The soft sensor takes most of a step, its products and sums most of that."""
    counted, _ = profile
    name, cycles = counted.by_function()[0]
    assert name == "narx_step"
    assert cycles > 0.8 * counted.total
    products = sum(cycles for line, cycles in counted.by_line() if line.startswith("core/dot.h:"))
    assert products > 0.5 * counted.total


def test_dearest_first(profile):
    """Functions and lines are in order of cost, instructions in order of address."""
    counted, _ = profile
    for sums in (counted.by_function(), counted.by_line()):
        costs = [cycles for _, cycles in sums]
        assert costs == sorted(costs, reverse=True)
    addresses = [address for address, _ in counted.by_instruction()]
    assert addresses == sorted(addresses)


def test_lines_are_those_of_the_sources(profile, image):
    """Every line named for the core exists; a division is where a division is written."""
    counted, _ = profile
    for place, _ in counted.by_line():
        file, _, number = place.rpartition(":")
        assert int(number) <= len((HERE / file).read_text().splitlines())
    divisions = [place for place, cycles in counted.by_line() if place.startswith("core/tansig.h")]
    texts = (HERE / "core" / "tansig.h").read_text().splitlines()
    assert any("p / q" in texts[int(place.rpartition(":")[2]) - 1] for place in divisions)
    assert image.line_at(0x08000000 - 4) == ""
