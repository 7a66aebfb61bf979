"""The outcome document as tables: every figure stands in the document, bounds are rounded the safe way."""

import io

import pytest
from rich.console import Console

from campaigns.export import road_tables
from campaigns.sheets import Cell, Sheet, at, invalid_lines, rich_table, sheets
from tests.campaigns.synthetic import row

ROWS = [
    *(row("hold", "CD", k, 0.5 + 0.1 * k, "hold") for k in range(19)),
    row("hold", "MD", 20),
    row("hold", "INVALID", 21, reason="frames lost"),
    *(row("uncalibration", "CD", k, 2.0, parameters={"gain": gain}) for k in (1, 2) for gain in (1.1, 1.2)),
    *(row("fault-free", "OK", k) for k in range(5)),
]
PUBLISHED = {"CD": {"hold": 100.0, "uncalibration": 95.0}, "TD_s": {"hold": [1.4, 0.2]}}
TABLES = road_tables(ROWS)
SHEETS = {sheet.name: sheet for sheet in sheets(TABLES, PUBLISHED)}


def line(name, begin, found=None):
    sheet = (found or SHEETS)[name]
    (cells,) = [cells for cells in sheet.rows if cells[0].text == begin]
    return {head: cell for head, cell in zip(sheet.heads, cells, strict=True)}


def test_cells_are_figures_of_the_document():
    """Each cell with a key shows what stands under that key in the document."""
    groups = [*TABLES["conditions"], *TABLES["fault_free"], *TABLES["curves"], *TABLES["steps"]]
    keys = {group["key"]: group for group in groups}
    cells = [cell for sheet in SHEETS.values() for cells in sheet.rows for cell in cells if cell.key]
    assert len(cells) > 60
    for cell in cells:
        key = max((key for key in keys if cell.key.startswith(f"{key}.")), key=len)
        assert at(keys[key], cell.key.removeprefix(f"{key}.")) == cell.value


def test_detection():
    """Performance has counts, the rate, its interval, the coverage supported and the thesis's figure."""
    cells = line("Diagnostic performance (Table V.14)", "hold")
    assert cells["CD %"] == Cell("95.0", "hold.rates.CD.value", 0.95)
    assert [cells[head].text for head in ("INVALID", "n", "CD", "MD", "95 % interval")] == [
        "1", "20", "19", "1", "76.4-99.1"
    ]  # fmt: skip
    assert cells["thesis CD %"].text == "100.0"


def test_bounds_are_rounded_the_safe_way():
    """The coverage is rounded down, the alarms per hour up: neither claims more than was shown."""
    # Clopper-Pearson 0.78389, 3 / 0.5 h
    assert line("Diagnostic performance (Table V.14)", "hold")["DC at least, %"].text == "78.3"
    assert line("Without a fault", "fault-free")["alarms/h at most"].text == "6.000"
    tables = road_tables([row("fault-free", "OK", 1, ridden_s=3600 * 2.9)])
    (sheet,) = [sheet for sheet in sheets(tables) if sheet.name == "Without a fault"]
    assert sheet.rows[0][-1].text == "1.035"
    assert sheet.rows[0][-1].value == pytest.approx(3 / 2.9)


def test_kind_named():
    """How many alarms named a kind, how many the right one; no such columns where none named any."""
    cells = line("Diagnostic performance (Table V.14)", "hold")
    assert [cells[head].text for head in ("kind named", "right %", "right, 95 %")] == [
        "19",
        "100.0",
        "83.2-100.0",
    ]
    (sheet, *_) = sheets(road_tables([row("hold", "CD", 1, 0.5)]))
    assert "kind named" not in sheet.heads


def test_swept_has_no_published_figure():
    """What a sweep changed stands without the thesis's figure."""
    assert line("Diagnostic performance (Table V.14)", "uncalibration[gain=1.1]")["thesis CD %"].text == "-"
    assert line("Time to detect, s (Table V.15)", "hold")["thesis mean, sigma"].text == "1.4, 0.2"


def test_ftti_only_where_given():
    """Columns of the tolerant interval are there only where there is one."""
    assert "FTTI" not in SHEETS["Time to detect, s (Table V.15)"].heads
    found = {sheet.name: sheet for sheet in sheets(road_tables(ROWS, ftti_s=2.0))}
    cells = line("Time to detect, s (Table V.15)", "hold", found)
    assert [cells[head].text for head in ("FTTI", "margin max", "beyond FTTI")] == ["2.000", "-0.300", "4"]


def test_empty_sheets_are_left_out():
    """A campaign without fault-free laps or a sweep has no table of them."""
    names = [sheet.name for sheet in sheets(road_tables([row("hold", "CD", 1, 0.5)]))]
    assert names == [
        "Diagnostic performance (Table V.14)",
        "Time to detect, s (Table V.15)",
        "Execution time of one step, us (Table V.13)",
    ]


@pytest.mark.parametrize("rows", [ROWS, ROWS[:3]])
def test_invalid_lines(rows):
    """Invalid runs are named with their reason; that there is none is said, too."""
    head, *runs = invalid_lines(road_tables(rows))
    if rows is ROWS:
        assert head == "INVALID runs: 1 of 30, they enter no rate"
        assert runs == [f"hold, seed 21, mixed_5km, gsxr1000 ({ROWS[20].id}): frames lost"]
    else:
        assert (head, runs) == ("INVALID runs: none of 3", [])


def shown(sheet, width):
    out = io.StringIO()
    Console(file=out, width=width).print(rich_table(sheet), highlight=False)
    return out.getvalue()


def test_rich_table():
    """The terminal shows the same texts, brackets of a sweep's parameters included."""
    said = shown(SHEETS["Diagnostic performance (Table V.14)"], 200)
    (cells,) = [line.split() for line in said.splitlines() if line.startswith("hold ")]
    assert cells == [cell.text for cell in SHEETS["Diagnostic performance (Table V.14)"].rows[0]]
    assert "uncalibration[gain=1.1]" in said


@pytest.mark.parametrize("width", [60, 80, 120])
def test_narrow_terminal(width):
    """Where the columns do not fit beside each other they stand below each other, none cut short."""
    sheet = SHEETS["Diagnostic performance (Table V.14)"]
    said = shown(sheet, width)
    assert max(map(len, said.splitlines())) <= width
    cells = [line.split() for line in said.splitlines() if line.startswith("hold ")]
    assert [cell for line in cells for cell in line[1:]] == [cell.text for cell in sheet.rows[0][1:]]
    assert "…" not in said


def test_marked_cells():
    """A marked cell is set off on the terminal, too."""
    sheet = Sheet("V.1", ["n", "L = 10 ms"], [[Cell("1"), Cell("97.7", marked=True)]])
    out = io.StringIO()
    Console(file=out, width=80, force_terminal=True, color_system="standard").print(rich_table(sheet))
    assert "\x1b[7m97.7" in out.getvalue()
