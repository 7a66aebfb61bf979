"""Detection curves: CD against magnitude, and the smallest magnitude found."""

import pytest

from campaigns.detection import detection_curves
from tests.campaigns.synthetic import row


def swept(name, hits, n=10, condition="uncalibration", **others):
    """`hits`: magnitude -> how many of `n` runs found it."""
    return [
        row(condition, "CD" if k < found else "MD", k, 1.0 if k < found else None,
            parameters={name: magnitude, **others})
        for magnitude, found in hits.items()
        for k in range(n)
    ]  # fmt: skip


def test_points():
    """A point has the magnitude, how many of the valid runs found it, and the interval."""
    rows = [*swept("gain", {1.2: 10, 1.1: 8}), row("uncalibration", "INVALID", 99, parameters={"gain": 1.1})]
    (curve,) = detection_curves(rows)
    assert (curve["key"], curve["condition"], curve["parameter"]) == (
        "uncalibration[gain]",
        "uncalibration",
        "gain",
    )
    first, second = curve["points"]
    assert (first["magnitude"], first["n"], first["CD"], first["invalid"]) == (1.1, 10, 8, 1)
    assert first["interval"] == pytest.approx([0.4902, 0.9433], abs=5e-5)
    assert (second["magnitude"], second["value"]) == (1.2, 1.0)


def test_smallest():
    """On each side of neutral, the smallest magnitude from which on all are found in 90 % of the runs."""
    hits = {0.8: 10, 0.9: 9, 0.95: 8, 0.98: 10, 1.02: 0, 1.05: 9, 1.08: 8, 1.1: 9, 1.2: 10}
    (curve,) = detection_curves(swept("gain", hits))
    assert curve["smallest"] == {
        "below": {"magnitude": 0.9, "distance": 0.1},
        "above": {"magnitude": 1.1, "distance": 0.1},
    }


def test_nothing_found():
    """Where the largest magnitude escapes, none was found on that side; nor where none was tried."""
    (curve,) = detection_curves(swept("by", {1.0: 10, 2.0: 10, 5.0: 8}, condition="offset"))
    assert curve["smallest"] == {"below": None, "above": None}


def test_magnitude_without_a_valid_run():
    """A magnitude of which no run counts is not known to be found: nothing beyond it is claimed."""
    rows = swept("mm", {1.0: 10, 2.0: 10}, condition="offset")
    rows += [row("offset", "INVALID", 1, parameters={"mm": 5.0})]
    (curve,) = detection_curves(rows)
    assert curve["smallest"]["above"] is None
    assert (curve["points"][-1]["n"], curve["points"][-1]["value"]) == (0, None)


def test_other_parameters():
    """Of two swept parameters each has a curve for every value of the other; words have none."""
    rows = [
        *swept("gain", {1.1: 5, 1.2: 10}, L_ms=50),
        *swept("gain", {1.1: 9, 1.2: 10}, L_ms=100),
    ]
    curves = {curve["key"]: curve for curve in detection_curves(rows)}
    assert list(curves) == [
        "uncalibration[L_ms,gain=1.1]",
        "uncalibration[L_ms,gain=1.2]",
        "uncalibration[gain,L_ms=50]",
        "uncalibration[gain,L_ms=100]",
    ]
    assert curves["uncalibration[gain,L_ms=100]"]["smallest"]["above"]["magnitude"] == 1.1
    assert curves["uncalibration[L_ms,gain=1.1]"]["smallest"] is None


@pytest.mark.parametrize("parameters", [{}, {"gain": 1.1}, {"motorcycle": "gsxr1000"}, {"load": True}])
def test_no_curve(parameters):
    """One magnitude is no curve, nor is a word."""
    assert detection_curves([row("uncalibration", "CD", k, 1.0, parameters=parameters) for k in (1, 2)]) == []
