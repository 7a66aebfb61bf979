import tracemalloc

import numpy as np
import pytest

from bench.errors import RouteError
from bench.plant.road.opencrg import line, parse

LAYOUTS = ("LRFI", "LDFI", "KRBI", "KDBI")


def heights(rows=12, columns=3, seed=0):
    return np.round(np.random.default_rng(seed).uniform(-0.05, 0.05, (rows, columns)), 5)


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("promise", [True, False])
def test_every_format_is_read(crg, layout, promise):
    """Text and binary, single and double, with and without the length promised, give the heights written."""
    grid = parse(crg(heights(), layout, promise=promise))
    assert grid.height_m == pytest.approx(heights(), abs=1e-6)
    assert grid.v_m == pytest.approx([-1, 0, 1])
    assert grid.step_m == 0.5


@pytest.mark.parametrize("layout", LAYOUTS)
def test_rows_longer_than_a_record_are_read(crg, layout):
    """A row of 25 sections goes over several records and comes back whole."""
    z = heights(7, 25)
    assert parse(crg(z, layout, v=np.arange(25) * 0.1 - 1.2)).height_m == pytest.approx(z, abs=1e-6)


def test_lines_may_end_the_windows_way(crg):
    """A text file with carriage returns is the same file."""
    grid = parse(crg(heights()).replace(b"\n", b"\r\n"))
    assert grid.height_m == pytest.approx(heights())


def test_numbers_may_touch(crg):
    """Columns are of fixed width: a minus sign needs no blank before it."""
    z = np.full((3, 3), -1.5)
    content = crg(z)
    assert b"-1.5000000-1.5000000" in content
    assert parse(content).height_m == pytest.approx(z)


@pytest.mark.parametrize(
    ("keys", "v"),
    [
        ({"V_RIGHT": -1.0, "V_INCREMENT": 0.75}, [-1, -0.25, 0.5]),
        ({"V_RIGHT": -1.0, "V_LEFT": 2.0}, [-1, 0.5, 2]),
        ({"V_LEFT": 2.0, "V_INCREMENT": 0.5}, [1, 1.5, 2]),
        ({"V_INCREMENT": 0.5}, [-0.5, 0, 0.5]),
    ],
)
def test_numbered_sections_lie_where_edges_and_increment_say(crg, keys, v):
    """Numbered long sections get their places from the edges and the increment, as many as are given."""
    content = crg(heights(), lines=[(f"LONG_SECTION_{key}", value) for key, value in keys.items()])
    for k, place in enumerate((b"-1.000", b"0.000", b"1.000"), 1):
        content = content.replace(b"at v = " + place, b"%d" % k)
    assert parse(content).v_m == pytest.approx(v)


def test_sections_in_any_order_are_sorted(crg):
    """Long sections written from left to right come out from right to left, with their heights."""
    grid = parse(crg(heights(), v=(1.0, 0.0, -1.0)))
    assert grid.v_m == pytest.approx([-1, 0, 1])
    assert grid.height_m == pytest.approx(heights()[:, ::-1])


def test_a_line_between_sections_is_interpolated(crg):
    """A quarter of the way between two sections the height is a quarter of the way between theirs."""
    grid = parse(crg(heights()))
    assert line(grid, 0.25) == pytest.approx(0.75 * heights()[:, 1] + 0.25 * heights()[:, 2])
    assert line(grid, 1.0) == pytest.approx(heights()[:, 2])


def test_the_reference_lines_slope_is_added(crg):
    """A road of slope 0.1 rises by 5 cm a row of half a metre; the first row's slope is unused."""
    slope = np.full(12, 0.1)
    slope[0] = np.nan
    grid = parse(crg(np.zeros((12, 3)), slope=slope))
    assert line(grid, 0.0) == pytest.approx(0.05 * np.arange(12))


def test_a_constant_slope_and_banking_are_added(crg):
    """Slope and banking given once hold for the whole road."""
    lines = [("REFERENCE_LINE_START_S", 0.02), ("REFERENCE_LINE_START_B", 0.03)]
    grid = parse(crg(np.zeros((12, 3)), lines=lines))
    assert line(grid, 1.0) == pytest.approx(0.01 * np.arange(12) + 0.03)


HOLES = np.array([[np.nan, 1.0, 2.0], [1.0, np.nan, 3.0], [np.nan, np.nan, 5.0], [1.0, 2.0, np.nan]])


@pytest.mark.parametrize("layout", LAYOUTS)
def test_holes_are_filled_from_their_neighbours(crg, layout):
    """Without modifiers a hole is the last valid value to its right, at the right edge to its left."""
    grid = parse(crg(HOLES, layout))
    assert grid.height_m == pytest.approx(np.array([[1, 1, 2], [1, 1, 3], [5, 5, 5], [1, 2, 2]]))


def test_holes_become_zero_where_the_file_says_so(crg):
    """GRID_NAN_MODE 1 puts zero, and the offset, where nothing was measured."""
    grid = parse(crg(HOLES, mods={"GRID_NAN_MODE": 1, "GRID_NAN_OFFSET": 0.25}))
    assert grid.height_m[0, 0] == 0.25
    assert grid.height_m[1, 2] == 3.0


@pytest.mark.parametrize("mods", [{}, {"GRID_NAN_MODE": 0}])
def test_holes_stay_where_the_file_says_so(crg, mods):
    """An empty section of modifiers keeps the holes; a line across one is refused, any other is read."""
    grid = parse(crg(HOLES, mods=mods))
    with pytest.raises(RouteError, match=r"row 2: nothing was measured at v = 0 m"):
        line(grid, 0.0)
    assert np.isfinite(line(parse(crg(HOLES[:3], mods=mods)), 1.0)).all()


def test_a_row_without_a_height_is_refused(crg):
    """Where a whole row was not measured nothing can be filled in."""
    z = heights()
    z[4] = np.nan
    with pytest.raises(RouteError, match="row 5: nothing was measured"):
        line(parse(crg(z)), 0.0)


def test_modifiers_scale(crg):
    """Height, length and width are scaled as the modifiers say."""
    grid = parse(crg(heights(), mods={"SCALE_Z_GRID": 2.0, "SCALE_LENGTH": 3.0, "SCALE_WIDTH": 0.5}))
    assert grid.height_m == pytest.approx(2 * heights())
    assert grid.step_m == 1.5
    assert grid.v_m == pytest.approx([-0.5, 0, 0.5])


def test_refuses_a_line_beside_the_road(crg):
    """A line outside the sections is refused with the road's width."""
    with pytest.raises(RouteError, match=r"profile_v_m is 1\.5, outside the road's -1 to 1 m"):
        line(parse(crg(heights())), 1.5)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        (b"0.5   !", b"0.0   !", "reference_line_increment is 0, not from"),
        (b"0.5   !", b"much  !", "line 6: REFERENCE_LINE_INCREMENT is 'much', not a number"),
        (b"0.5   !", b"1e400 !", "REFERENCE_LINE_INCREMENT is 1e400, too large"),
        (b"105.5", b"105.3", "5.3 m of reference line is no whole number of steps of 0.5 m"),
        (b"105.5", b"106.0", "the file ends after 48 numbers; 13 rows of 4 were to come"),
        (b"105.5", b"1e9", "the file ends after 48 numbers; 1999999801 rows of 4"),
        (b"#:LRFI", b"#:LRFX", "line 11: unknown format 'LRFX'"),
        (b"v = 1.000,m", b"v = 1.000,ft", "line 16: long section at v = 1.000 is in 'ft', not in m"),
        (b"v = 1.000", b"v = 0.000", "two long sections at one v"),
        (b"v = 1.000", b"v = left", "line 16: long section at v = left is 'left', not a number"),
        (b"at v = 1.000", b"3", "3 long sections; a road takes two, of one kind"),
        (b"long section", b"wrong section", "0 long sections; a road takes two"),
        (b"$ROAD_CRG !", b"$ROAD_CRG_FILE !", "line 4: refers to other files"),
        (b"$$$$", b"####", "no data"),
        (b"\n 0.0", b"\n x.0", "line 20: reference line phi is 'x.0000000', not a number"),
    ],
)
def test_refuses_what_is_no_road(crg, old, new, says):
    """A header or a number that cannot be is refused by line and value."""
    content = crg(heights())
    assert old in content
    with pytest.raises(RouteError, match=says):
        parse(content.replace(old, new, 1) if old != b"long section" else content.replace(old, new))


def test_refuses_text_with_too_many_numbers(crg):
    """A row with a number more than the header names is refused by line."""
    content = crg(heights())
    with pytest.raises(RouteError, match="line 30: more than 4 numbers of 10 characters"):
        parse(content.rstrip(b"\n") + b" 1.0000000\n")


def test_refuses_a_height_that_is_none(crg):
    """A height beyond any on earth is refused at its byte."""
    z = heights()
    z[5, 1] = 1e30
    content = crg(z, "KRBI")
    at = content.index(np.array(1e30, ">f4").tobytes())
    with pytest.raises(RouteError, match=f"byte {at}: 1e\\+30 is no height on earth"):
        parse(content)


def test_refuses_a_truncated_binary_file(crg):
    """A binary file cut short is refused with the byte at which it ends and what is missing."""
    content = crg(heights(), "KRBI")[:-100]
    with pytest.raises(
        RouteError, match=rf"byte {len(content)}: the file ends here, 52 bytes short of 12 rows"
    ):
        parse(content)


def test_refuses_a_binary_file_that_is_too_long(crg):
    """More data than the header promises is refused."""
    with pytest.raises(RouteError, match="bytes more than 12 rows take"):
        parse(crg(heights(), "KRBI") + bytes(400))


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_hostile_header_allocates_nothing(crg, layout):
    """A promise of ten thousand million rows is refused within a few megabytes."""
    content = crg(heights(), layout, lines=[("REFERENCE_LINE_END_U", 5e9 + 100)])
    tracemalloc.start()
    with pytest.raises(RouteError, match="the file ends"):
        parse(content)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 4e6


def test_belgian_block_agrees_with_another_reader(measured_roads):
    """The measured Belgian block's centre line is the one pycrg reads, to the 0.01 mm it was written with."""
    grid = parse((measured_roads / "belgian_block.crg").read_bytes())
    assert grid.height_m.shape == (1001, 341)
    other = np.loadtxt(measured_roads / "belgian_centre_line.csv", delimiter=",", skiprows=1)
    centre = line(grid, 0.0)
    assert np.arange(1001) * grid.step_m == pytest.approx(other[:, 0])
    assert centre - centre[0] == pytest.approx(other[:, 1], abs=6e-6)
