"""Offline rows in figures: exclusive outcomes with intervals, and the thesis's values beside them."""

import io
import json
import random

import pytest
from rich.console import Console

from campaigns.offline_score import chosen, score
from campaigns.offline_shown import on_terminal, page_parts, tables
from campaigns.offline_tables import detection, grids, invalid, published, soe, summary
from campaigns.sheets import at
from campaigns.statistics import Rate
from tests.campaigns.offline_laps import FAULTS, plan

S = 1_000_000_000
ONE = plan(
    faults={"hold": FAULTS["hold"]}, L_ms=[10], n=[1], T_percent=[10], t_max_s=120, feedback=["predicted"]
)
FOUR = {name: FAULTS[name] for name in ("uncalibration", "open", "short", "hold")}
ALL = plan(faults=FOUR, L_ms=[10, 20, 50, 100, 150, 200], n=[1, 2, 3, 4, 5], T_percent=[5, 10], t_max_s=120)


def row(active, alarm, condition="hold", feedback="predicted", settings=ONE):
    """A trial whose every cell alarms at `alarm`; a function of (T, L, n) gives each its own."""
    at = alarm if callable(alarm) else lambda *_: alarm
    cells = {f"{t:g}": [[at(t, L, n) for n in settings.n] for L in settings.L_ms] for t in settings.T_percent}
    result = {"t_active_ns": active, "first_alarm_ns": None if active is None else cells}
    return {"kind": "offline", "condition": condition, "feedback": feedback}, result


def curve(percent):
    points = {"tolerance_percent": [0.0, percent, 2 * percent], "share": [1.0, 0.1, 0.0]}
    return {
        "beyond": {"5": 0.02, "10": 0.001},
        "worst_tenth_percent": percent,
        "worst_hundredth_percent": 2 * percent,
        **points,
    }


@pytest.fixture(scope="module")
def document():
    """50 faults a kind: the longer L n, the later found; fed back measured none but open circuits."""
    rows = []
    for feedback in ALL.feedback:
        for condition in FOUR:
            lost = feedback == "measured" and condition != "open"

            def at(t, L, n, lost=lost, condition=condition):
                if L * n < 40:
                    return 5 * S
                if lost or (condition == "uncalibration" and L * n > 200):
                    return None
                return 10 * S + L * n * 10_000_000

            rows += [row(10 * S, at, condition, feedback, ALL) for _ in range(49)]
            rows.append(row(None, None, condition, feedback, ALL))
        curves = {str(L): curve(30.0 / L) for L in (10, 500)}
        rows.append(({"kind": "offline_soe", "feedback": feedback}, {"curves": curves}))
    return score(ALL, rows)


def alone(document):
    """The document of a campaign without the measured feedback."""
    cells = [cell for cell in document["cells"] if cell["feedback"] == "predicted"]
    return {**document, "cells": cells, "soe": {"predicted": document["soe"]["predicted"]}}


@pytest.mark.parametrize(
    ("alarm", "outcome"),
    [
        (None, "MD"),
        (0, "FA"),
        (100 * S - 1, "FA"),
        (100 * S, "CD"),
        (220 * S, "CD"),
        (220 * S + 1, "MD"),
    ],
)
def test_outcomes(alarm, outcome):
    """Before the fault acts an alarm is false, until t_max it is right, later or never it is missed."""
    [cell] = score(ONE, [row(100 * S, alarm)])["cells"]
    assert {name: cell[name] for name in ("FA", "CD", "MD")} == {
        **dict.fromkeys(("FA", "CD", "MD"), 0),
        outcome: 1,
    }


def test_an_invalid_fault_enters_no_rate():
    """A fault that never acted is counted, and nothing else is made of it."""
    found = score(ONE, [row(None, None), row(100 * S, None), row(100 * S, 101 * S)])
    assert found["invalid"] == [{"feedback": "predicted", "condition": "hold", "n": 3, "INVALID": 1}]
    assert (found["cells"][0]["of"], found["cells"][0]["CD"]) == (2, 1)
    assert invalid(found).endswith("enter no rate: 1 of 3 hold (predicted)")
    assert invalid(score(ONE, [row(100 * S, None)])) == "INVALID faults: none of 1"


def test_none_but_invalid_faults():
    """Without a valid fault there is no rate, no interval and no grey cell, and the tables say so."""
    found = score(ONE, [row(None, None)])
    [cell] = found["cells"]
    assert (cell["of"], cell["grey"], cell["td_s"]["mean"]) == (0, False, None)
    assert cell["rates"]["FA"] == {"value": None, "interval": [None, None]}
    json.dumps(found, allow_nan=False)
    assert detection(ONE, found, "predicted", 10.0, "hold", "CD").rows[0][1].text.startswith("-")
    assert list(grids(ONE, found))


def test_rates_have_wilson_intervals_and_add_up(document):
    """Every cell's outcomes add up to its valid faults, each with its interval."""
    assert len(document["cells"]) == 2 * 2 * 4 * 30
    for cell in document["cells"]:
        assert cell["FA"] + cell["CD"] + cell["MD"] == cell["of"] == 49
        for outcome in ("FA", "CD", "MD"):
            rate = Rate(cell[outcome], 49)
            assert cell["rates"][outcome] == {"value": rate.value, "interval": list(rate.interval)}


@pytest.mark.parametrize(
    ("false", "missed", "grey"), [(1, 2, True), (2, 0, False), (0, 3, False), (0, 0, True)]
)
def test_grey_cells(false, missed, grey):
    """A cell is grey with at most 1 % false alarms and at most 2 % missed detections."""
    rows = [row(9 * S, 0)] * false + [row(9 * S, None)] * missed
    rows += [row(9 * S, 9 * S)] * (100 - len(rows))
    assert score(ONE, rows)["cells"][0]["grey"] is grey


def test_times_to_detect_are_the_correct_detections():
    """Mean and prompt share are over correct detections alone; prompt is below L_obs + 2 s."""
    alarms = (9 * S, 10 * S + 500_000_000, 12 * S + 9_000_000, 12 * S + 10_000_000, None, 140 * S)
    [cell] = score(ONE, [row(10 * S, alarm) for alarm in alarms])["cells"]
    assert cell["td_s"]["mean"] == pytest.approx((0.5 + 2.009 + 2.01) / 3)
    assert cell["td_s"]["prompt"] == pytest.approx(2 / 3)


def test_the_order_of_the_rows_changes_nothing():
    """Rows in any order give the same document, to the bit."""
    draw = random.Random(3)
    rows = [row(10 * S, 10 * S + draw.randrange(100 * S)) for _ in range(300)]
    first = json.dumps(score(ONE, rows))
    draw.shuffle(rows)
    assert json.dumps(score(ONE, rows)) == first


def test_curves_stand_by_their_windows():
    """The curves come in the order of L, though a store gives them back in that of their names."""
    curves = {name: curve(1.0) for name in ("10", "100", "20", "500")}
    found = score(ONE, [({"kind": "offline_soe", "feedback": "predicted"}, {"curves": curves})])
    assert list(found["soe"]["predicted"]) == ["10", "20", "100", "500"]


def test_the_thesiss_values_stand_beside_ours(document):
    """Tables V.1-V.12 hold the published value of the same cell, but only for what the thesis ran."""
    grid = detection(ALL, document, "predicted", 10.0, "uncalibration", "MD")
    assert grid.title.startswith("Table V.3  Losing calibration: Missed Detection percentage, T = 10 %")
    assert grid.heads == ("n \\ L", "10 ms", "20 ms", "50 ms", "100 ms", "150 ms", "200 ms")
    assert grid.rows[4][3].text.split() == ["100.0", "100.0", "92.7-100.0"]
    assert grid.rows[2][2].text.split() == ["0.0*", "0.8", "0.0-7.3"]
    assert detection(ALL, document, "predicted", 10.0, "hold", "FA").title.startswith("Table V.10  Hold")
    for feedback, t in (("predicted", 5.0), ("measured", 10.0)):
        other = detection(ALL, document, feedback, t, "hold", "FA")
        assert other.title.startswith("Hold: False Alarm percentage")
        assert len(other.rows[0][1].text.split()) == 2
    assert published(ALL, "predicted", 10.0, "hold")[100, 1] == {"FA": 0.0, "CD": 92.2, "MD": 7.8}
    assert not published(ALL.model_copy(update={"t_max_s": 60.0}), "predicted", 10.0, "hold")
    other = plan(faults={"hold": "rear_stroke:uncalibration:gain=1.2"}, t_max_s=120)
    assert not published(other, "predicted", 10.0, "hold")


def test_grey_marks(document):
    """The cells marked with a star, and drawn reversed, are those whose three rates make them grey."""
    for condition in FOUR:
        for outcome in ("FA", "CD", "MD"):
            grid = detection(ALL, document, "predicted", 10.0, condition, outcome)
            for k, n in enumerate(ALL.n):
                for j, L in enumerate(ALL.L_ms, 1):
                    grey = L * n >= 40 and not (condition == "uncalibration" and L * n > 200)
                    assert ("*" in grid.rows[k][j].text) is ((k, j) in grid.grey) is grey


def test_the_negative_result_is_seen_at_a_glance(document):
    """The summary has each fault's CD for both feedbacks at the best cell, of equals the thesis's best."""
    grid = summary(ALL, document, 10.0)
    assert grid.title.startswith("Correct detections at L = 20 ms, n = 2, T = 10 %")
    by_name = {texts[0]: texts[1:] for texts in (tuple(cell.text for cell in cells) for cells in grid.rows)}
    assert by_name["Hold"] == ("49", "26/30", "4/30", "100.0 (92.7-100.0)", "99.4", "0.0 (0.0-7.3)")
    assert by_name["Open circuit"][-1] == "100.0 (92.7-100.0)"
    assert grid.caption.endswith("and fewer are found of losing calibration, short circuit, hold")
    assert "negative" not in summary(ALL, alone(document), 10.0).caption
    assert chosen(document, "guessed", 10.0, {}) is None


def test_curves_in_figures(document):
    """The SOE table holds what a tenth and a hundredth of the windows exceed, and the thesis's tenth."""
    grid = soe(ALL, document)
    assert tuple(cell.text for cell in grid.rows[0]) == (
        "10 ms",
        *("3.00", "6.00", "2.000", "0.100") * 2,
        "5",
    )
    assert len(grid.heads) == 10


@pytest.mark.parametrize("columns", [80, 120])
def test_everything_fits_a_terminal(document, columns):
    """No line is longer than the screen, no cell is cut, and every table is there."""
    screen = Console(width=columns, file=io.StringIO(), force_terminal=False)
    for part in tables(ALL, document):
        screen.print(part, highlight=False)
    text = screen.file.getvalue()
    assert max(len(line) for line in text.splitlines()) <= columns
    assert "…" not in text
    for number in range(1, 13):
        assert text.count(f"Table V.{number}  ") == 1
    assert text.splitlines()[0].startswith("INVALID faults, which changed no sample")
    assert len(list(grids(ALL, document))) == 2 + 2 * 2 * (12 + 4) + 1


def test_a_cell_keeps_its_lines_in_120_columns(document):
    """At 120 columns no row is taller than what its cells hold."""
    screen = Console(width=120, file=io.StringIO(), force_terminal=False)
    for grid in grids(ALL, document):
        screen.print(on_terminal(grid._replace(title="-", caption="")))
        lines = 2 if any("\n" in cell.text for cell in grid.rows[0]) else 1
        printed = screen.file.getvalue().rstrip("\n").split("\n")
        assert len(printed) == 2 + lines * len(grid.rows)
        screen.file = io.StringIO()


def test_a_page_holds_the_documents_figures(document):
    """Every table is a sheet whose figures name their place in the document, and every curve is drawn."""
    sheets, plots = page_parts(ALL, document)
    assert len(sheets) == 1 + len(list(grids(ALL, document)))
    keys = {cell["key"]: cell for cell in document["cells"]}
    assert len(keys) == len(document["cells"])
    figures = [cell for sheet in sheets for row in sheet.rows for cell in row if cell.key]
    assert len(figures) == 2 * 4 * 3 + 2 * 2 * 4 * 4 * 30
    for figure in figures:
        key, _, path = figure.key.partition("].")
        assert at(keys[f"{key}]"], path) == figure.value
    assert [len(plot["lines"]) for plot in plots] == [2, 2]
    assert plots[0]["lines"][0]["x"] == document["soe"]["predicted"]["10"]["tolerance_percent"]
    json.dumps(plots, allow_nan=False)
