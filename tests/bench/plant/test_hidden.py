import numpy as np
import pytest

from bench.plant.dynamics import equilibrium
from bench.plant.hidden import LOAD_KG, TYRE, draw, lean, loaded, oil, posture, smooth
from bench.plant.motorcycle import load_motorcycle
from bench.plant.route import Stretch

BIKE = load_motorcycle()


def rng(seed=0):
    return np.random.Generator(np.random.PCG64(seed))


def test_draws_differ_between_seeds_and_stay_within_two_sigma():
    """Over 200 seeds load and tyres spread as stated, and no draw lies beyond two standard deviations."""
    drawn = [draw(np.random.SeedSequence(seed)) for seed in range(200)]
    loads, tyres = (np.array([getattr(h, name) for h in drawn]) for name in ("load_kg", "tyre"))
    assert loads.std() == pytest.approx(LOAD_KG, rel=0.2)
    assert np.abs(loads).max() <= 2 * LOAD_KG
    assert tyres.std() == pytest.approx(TYRE, rel=0.2)
    assert np.abs(tyres - 1).max() <= 2.001 * TYRE


def test_load_lowers_both_ends():
    """Four kilograms more on the body deepen both struts by less than 2 mm."""
    hidden = draw(np.random.SeedSequence(0))
    light, heavy = (equilibrium(loaded(BIKE, hidden._replace(load_kg=kg))) for kg in (0.0, 4.0))
    sunk = light[0] - heavy[0]
    assert 0.0005 < sunk < 0.002


def test_soft_tyres_sink_deeper():
    """A softer tyre is pressed flatter by the same weight, and the strokes at rest are the same."""
    hidden = draw(np.random.SeedSequence(0))
    soft, hard = (equilibrium(loaded(BIKE, hidden._replace(tyre=factor))) for factor in (0.9, 1.1))
    assert soft[2] < hard[2] < 0
    assert soft[0] - soft[2] == pytest.approx(hard[0] - hard[2], abs=2e-4)


def test_oil_thins_as_it_warms():
    """The dampers' oil damps less towards the end of a lap, more on a cold day, by 15 % at most."""
    hidden = draw(np.random.SeedSequence(0))
    cold, hot = (oil(hidden._replace(oil_c=c), 300_000) for c in (25.0, 45.0))
    for factor in (cold, hot):
        assert np.all(np.diff(factor) < 0)
        assert 0.85 < factor.min() < factor.max() < 1.15
    assert np.all(cold > hot)


def test_the_rider_shifts_by_centimetres():
    """The rider's moment is of centimetres of the upper body and changes over seconds, not samples."""
    moment = posture(BIKE, 300_000, rng())
    assert 0.01 < moment.std() / (BIKE.rider_kg * 9.81) < 0.04
    assert np.abs(np.diff(moment)).max() < 0.05


def test_lean_follows_the_stretches():
    """The lean is what each stretch says: none on a straight one, both ways on a winding one."""
    stretches = tuple(
        Stretch(surface="smooth", length_m=5000, speed_kmh=60, lean_deg=angle) for angle in (0.0, 20.0)
    )
    angle = np.degrees(lean(stretches, np.arange(0.0, 10_000.0, 1.0), rng()))
    assert np.abs(angle[:4900]).max() == 0.0
    assert 8 < angle[5100:].std() < 25
    assert angle.min() < -10
    assert angle.max() > 10


def test_smooth_passes_through_its_knots():
    """Between two knots the curve is level at both ends and never beyond them."""
    knots = np.array([0.0, 1.0, -1.0])
    curve = smooth(knots, np.linspace(0, 2, 2001))
    assert curve[[0, 1000, 2000]] == pytest.approx(knots)
    assert np.abs(np.diff(curve)[[0, 999, 1000, -1]]).max() < 1e-4
    assert curve.max() <= 1
