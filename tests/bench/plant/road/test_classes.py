import pytest

from bench.errors import RouteError
from bench.plant.road.classes import CLASSES, class_table
from bench.plant.road.iso8608 import LEVELS_M3
from bench.plant.road.surface import SURFACES

EVEN = [name for name, surface in SURFACES.items() if not surface.stone_m]


@pytest.mark.parametrize("seed", range(3))
def test_every_class_keeps_its_limits(seed):
    """Of 5 km of each class A to H every band lies within the limits, and the line is the class's."""
    rows = class_table(seed=seed)
    assert [row.surface for row in rows] == list(CLASSES)
    for row, (letter, level) in zip(rows, LEVELS_M3.items(), strict=True):
        assert row.iso == letter
        assert row.inside == 1.0
        assert row.level_m3 == pytest.approx(level, rel=0.15)
        assert row.slope == pytest.approx(-2.0, abs=0.08)
        assert (row.lower_m3, row.upper_m3) == (level / 2, level * 2)


def test_every_even_surface_keeps_to_its_level():
    """Surfaces without stones lie within a factor of two of their own level in every band."""
    for row in class_table(EVEN):
        assert row.inside == 1.0
        assert row.level_m3 == pytest.approx(SURFACES[row.surface].roughness_m3, rel=0.15)


def test_stones_lift_the_short_waves():
    """Cobblestone and pave fall less steeply than their bed, and leave its limits about the stones."""
    for row in class_table(["cobblestone", "pave"]):
        assert row.slope > -1.8
        assert 0.4 < row.inside < 0.9


def test_rows_are_roads_of_their_own():
    """No class is another one drawn to a larger scale."""
    assert len({round(row.slope, 6) for row in class_table(length_m=500)}) == len(CLASSES)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"surfaces": ["ice"]}, "unknown surface 'ice'; the known ones are smooth"),
        ({"length_m": 10.0}, "length_m is 10.0, not a number from 200 to 100000"),
    ],
)
def test_refuses_what_cannot_be_drawn(arguments, says):
    """An unknown surface and a length without a spectrum are refused by value."""
    with pytest.raises(RouteError, match=says):
        class_table(**arguments)
