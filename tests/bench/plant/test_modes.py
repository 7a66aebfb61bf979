import numpy as np
import pytest

from bench.plant.modes import attitude, identified, modes, one_g, without_seals
from bench.plant.motorcycle import NAMES, load_motorcycle

CONVENTIONAL = [name for name in NAMES if name != "gsxr1000_magneto"]


@pytest.mark.parametrize("name", CONVENTIONAL)
def test_modes_are_a_motorcycles(name):
    """Heave at 1.5-2.5 Hz, pitch at 3-5, the rider at 5-7, wheel hop at 11-16, each damped to 0.15-0.7."""
    found = modes(without_seals(load_motorcycle(name)))
    ranges = [("heave", 1.5, 2.5), ("pitch", 3, 5), ("rider", 5, 7), ("wheel", 11, 16), ("wheel", 11, 16)]
    for mode, (part, low, high) in zip(found, ranges, strict=True):
        assert part in mode.name
        assert low < mode.hz < high
        assert 0.15 < mode.damping < 0.7


@pytest.mark.parametrize("name", NAMES)
def test_the_simulation_moves_as_its_linearisation_says(name):
    """Modes found in the simulated motion lie within 3 % of the linearised ones in frequency and damping."""
    bike = without_seals(load_motorcycle(name))
    for mine, theirs in zip(modes(bike), identified(bike), strict=True):
        assert theirs.hz == pytest.approx(mine.hz, rel=0.03)
        assert theirs.damping == pytest.approx(mine.damping, rel=0.04)


def test_stiffer_springs_ring_faster():
    """Both springs twice as stiff raise heave by the square root of two, within the tyres' share."""
    bike = without_seals(load_motorcycle())
    hard = bike._replace(
        fork=bike.fork._replace(spring_n_per_m=2 * bike.fork.spring_n_per_m),
        shock=bike.shock._replace(spring_n_per_m=2 * bike.shock.spring_n_per_m),
    )
    assert modes(hard)[0].hz == pytest.approx(modes(bike)[0].hz * np.sqrt(2), rel=0.15)


@pytest.mark.parametrize("name", NAMES)
def test_attitude_at_rest_and_under_one_g(name):
    """Under 1 g braking the nose goes down by 3-8 degrees, the fork dives, the rear tyre still carries."""
    bike = load_motorcycle(name)
    rest, braking = attitude(bike), one_g(bike)
    assert 3 < braking.pitch_deg - rest.pitch_deg < 8
    assert braking.fork_mm > rest.fork_mm + 40
    assert 0 < braking.rear_n < 0.4 * rest.rear_n


@pytest.mark.parametrize("name", NAMES)
def test_the_rear_stroke_rests_mid_range(name):
    """At rest the rear stroke is within 15 mm of the middle of figure V.17's 39.25-80.09 mm."""
    assert attitude(load_motorcycle(name)).rear_mm == pytest.approx(59.67, abs=15)
