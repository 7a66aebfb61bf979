"""Rides for the decision maker's tests, with what the references in double precision say of them."""

from functools import cache

import numpy as np

from targets.calibration import Detector
from targets.checks import findings
from targets.detector import Checks
from targets.ifd import alarms, residual


@cache
def wild_ride():
    """Predicted and measured strokes of every sign and size, with runs of zeros."""
    rng = np.random.default_rng(11)
    predicted, measured = rng.uniform(-20, 120, (2, 400)).astype("<f4")
    measured[100:140] = 0
    measured[200:240] *= 1e-3
    return predicted, measured


@cache
def residual_rides():
    """Hundreds of short rides under detectors of every size, with what the reference says of each."""
    rng = np.random.default_rng(5)
    rides = []
    for _ in range(150):
        detector = Detector(
            threshold=float(rng.uniform(0.02, 0.3)),
            window=int(rng.integers(1, 9)),
            multiple=int(rng.integers(1, 5)),
            warmup=int(rng.integers(0, 12)),
            floor_mm=float(rng.uniform(0.1, 30)),
        )
        measured = rng.uniform(0, 60, 120).astype("<f4")
        wrong = np.repeat(rng.random(12) < 0.6, 10) * rng.uniform(0, 25, 120)
        predicted = (measured + wrong * rng.choice([-1, 1], 120)).astype("<f4")
        expected = residual(predicted, measured, detector)
        rides.append((detector, predicted, measured, expected, alarms(expected, detector)))
    return rides


GRID = 0.5
"""Strokes of the rides below are multiples of it, mm: single and double precision then compare alike."""


@cache
def checked_rides():
    """Short rides on a grid, where ties abound, under all sorts of checks; what the reference says."""
    rng = np.random.default_rng(3)
    rides = []
    for _ in range(400):
        checks = Checks(
            warmup=int(rng.integers(0, 6)),
            rail_steps=int(rng.integers(1, 6)),
            repeat_steps=int(rng.integers(1, 7)),
            hold_window=int(rng.integers(2, 10)),
            loss_window=int(rng.integers(1, 12)),
            heal_steps=int(rng.integers(1, 12)),
            rail_low_mm=GRID * int(rng.integers(0, 6)),
            rail_high_mm=GRID * int(rng.integers(30, 40)),
            rail_gap_mm=GRID * int(rng.integers(0, 8)),
            repeat_motion_mm=GRID * int(rng.integers(0, 8)),
            hold_ratio=float(rng.choice([0.0, 0.25, 0.5])),
            still_mm=GRID * int(rng.integers(0, 5)),
            loss_threshold=float(rng.uniform(0.0, 0.3)),
            loss_floor_mm=GRID * int(rng.integers(1, 20)),
        )
        measured = rng.integers(-2, 44, 100)
        for begin in rng.integers(0, 95, 6):
            measured[begin : begin + rng.integers(2, 14)] = rng.choice([-1, 0, 5, 20, 38, 43])
        predicted = measured + rng.integers(-4, 5, 100) * np.repeat(rng.integers(0, 4, 10), 10)
        ride = (GRID * predicted.astype("<f4"), GRID * measured.astype("<f4"))
        rides.append((checks, *ride, findings(*ride, checks)))
    return rides
