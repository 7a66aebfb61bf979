"""Curves and bars in the terminal: which dot stands for which value."""

import io
import sys
from itertools import pairwise

import numpy as np
import pytest

from bench.cli.draw import ASCII, BRAILLE, bar, curves, envelope, labels, number, plain, style_for, ticks


def drawn(t_s, values, width=12, style=ASCII, longest_s=np.inf, height=4):
    return curves(
        np.asarray(t_s, float), {"speed_kmh": np.asarray(values, float)}, longest_s, width, style, height
    )


def test_ramp_in_ascii():
    """A ramp rises from the lowest dot to the highest, its labels at their values."""
    assert drawn(np.arange(10), np.arange(10), 11) == [
        "speed_kmh, km/h",
        " |       .:",
        "5+    .:''",
        " | ..:'",
        "0+:'",
        " ++---+----",
        "  0   5 s",
    ]


def test_ramp_in_braille():
    """In braille a character is two columns of four dots: sixteen columns rise through eight rows of them."""
    assert drawn(np.arange(17), np.arange(17), 11, BRAILLE, height=2)[1:] == [
        "15┤   ⢀⣀⡤⠖⠋",
        " 5┤⣠⠴⠚⠉",
        "  └┬───┬───",
        "   0  10 s",
    ]


def test_every_peak_is_drawn():
    """One sample in 100,000 that stands out is seen, whatever the width."""
    values = np.zeros(100_000)
    values[54_321] = 1.0
    top = drawn(np.arange(100_000), values, 42)[1]
    assert top.split("+")[-1].strip() == ":"


def test_lines_are_as_wide_as_asked():
    """No line is wider than the terminal, and the axis ends with it."""
    t = np.linspace(0, 300, 5000)
    for width in (40, 80, 133):
        lines = drawn(t, np.sin(t), width, BRAILLE)
        assert max(len(line) for line in lines) == width
        assert len(lines[-2]) == width


def test_gap_is_blank():
    """Samples further apart than `longest_s` are not joined."""
    assert drawn([0, 1, 2, 8, 9, 10], [5, 5, 5, 5, 5, 5], 24, longest_s=1.5)[2] == "5.0+.....           ...."


def test_few_samples_hang_together():
    """Fewer samples than columns are joined by a line."""
    low, high = envelope(np.array([0.0, 10.0]), np.array([0.0, 10.0]), np.linspace(0, 10, 11), np.inf)
    assert low == pytest.approx(np.arange(10))
    assert high == pytest.approx(np.arange(1, 11))


def test_envelope_holds_what_lies_between():
    """The envelope is the lowest and highest sample of each interval, and the curve at its edges."""
    t, edges = np.arange(1000.0), np.linspace(0, 999, 38)
    values = np.random.default_rng(1).standard_normal(1000)
    low, high = envelope(t, values, edges, 1.5)
    for k, (start, end) in enumerate(pairwise(edges)):
        seen = np.interp(np.union1d(t[(t >= start) & (t <= end)], (start, end)), t, values)
        assert (low[k], high[k]) == pytest.approx((seen.min(), seen.max()))


def test_constant_is_a_line_in_the_middle():
    """A constant is drawn in the middle of its scale."""
    rows = drawn([0, 1, 2], [50, 50, 50])[1:5]
    assert [bool(row.split("+")[-1].split("|")[-1].strip()) for row in rows] == [False, True, False, False]


@pytest.mark.parametrize("values", [[-1.7e308, 1.7e308], [0, 5e-324], [1e9, 1e9 + 1e-6], [-3, -3], [0, 0]])
def test_any_range_is_drawn(values):
    """Whatever float64 holds is drawn without a warning."""
    with np.errstate(all="raise", under="ignore"):
        assert len(drawn([0, 1], values)) == 7


def test_channels_share_their_margin():
    """Drawn together, all channels begin in the same column."""
    t = np.linspace(0, 1, 100)
    lines = curves(t, {"speed_kmh": t, "acc_body_ms2": -1000 * t}, np.inf, 60, BRAILLE)
    assert (
        len({min(line.find(c) for c in "│┤" if c in line) for line in lines if "│" in line or "┤" in line})
        == 1
    )


@pytest.mark.parametrize(
    ("low", "high", "most", "expected"),
    [
        (0, 10, 4, [0, 5, 10]),
        (-76, 67, 4, [-50, 0, 50]),
        (0.31, 0.52, 4, [0.35, 0.4, 0.45, 0.5]),
        (0, 302, 8, range(0, 301, 50)),
    ],
)
def test_ticks_are_round(low, high, most, expected):
    """Ticks are round numbers inside the range, no more than there is room for."""
    assert ticks(low, high, most) == pytest.approx(list(expected))


def test_labels_have_the_same_decimals():
    """Labels of one axis have as many decimals as their step needs."""
    assert labels([-0.2, 0.0, 0.2]) == ["-0.2", "0.0", "0.2"]
    assert labels([0.0, 50.0, 100.0]) == ["0", "50", "100"]
    assert labels([0.0, 0.002, 0.004]) == ["0.000", "0.002", "0.004"]
    assert labels([-1e308, 0.0, 1e308]) == ["-1e+308", "0", "1e+308"]


def test_bars():
    """A bar is a share of the width, in eighths where there is braille; what is more than nothing shows."""
    assert bar(0.5, 4, BRAILLE) == "██"
    assert bar(0.53125, 4, BRAILLE) == "██▏"
    assert bar(0.0001, 4, BRAILLE) == "▏"
    assert bar(0.5, 4, ASCII) == "##"
    assert (bar(0.0, 4, ASCII), bar(float("nan"), 4, ASCII), bar(1.5, 4, ASCII)) == ("", "", "####")


def test_numbers():
    """Numbers have their decimals, an exponent when they would be long, and a dash when there is none."""
    assert [number(x) for x in (1.005, -2.0, 1e300, float("nan"))] == ["1.00", "-2.00", "1e+300", "-"]


@pytest.mark.parametrize(("encoding", "style"), [("utf-8", BRAILLE), ("ascii", ASCII), ("latin-1", ASCII)])
def test_style_of_the_output(monkeypatch, encoding, style):
    """Braille where the output can carry it, ASCII elsewhere and where it is asked for."""
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(io.BytesIO(), encoding))
    assert style_for() is style
    assert style_for(ascii_only=True) is ASCII


def test_plain_names(monkeypatch):
    """A name cannot steer the terminal, nor break an output that lacks its letters."""
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(io.BytesIO(), "ascii"))
    assert plain("a\x1b[31m\n") == r"a\x1b[31m\n"
    assert plain("Nürburg\udcff.csv") == r"N\xfcrburg\udcff.csv"
