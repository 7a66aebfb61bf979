"""The road trial's tables: invalid runs first and in no rate, the thesis's figures beside ours."""

import io
import tomllib
from pathlib import Path

import pytest
from rich.console import Console

from bench.verdict import Outcome
from campaigns import tables
from campaigns.plan import FAULT_FREE, HERE, Campaign, Trial
from campaigns.tables import road, thesis
from campaigns.trial import Result
from tests.conftest import SHARED

HZ = 22_000_000


def result(condition, outcome, seed=0, td_s=None, reason="", cycles=(5500,), hz=HZ, ridden_s=360.0):
    return Result(
        Trial(condition, "mixed_5km", "gsxr1000", "ideal", seed, "" if condition == FAULT_FREE else "fault"),
        outcome,
        reason,
        None if td_s is None else round(td_s * 1e9),
        round(ridden_s * 1e9),
        len(cycles),
        sum(cycles),
        sum(c * c for c in cycles),
        min(cycles, default=0),
        max(cycles, default=0),
        hz,
        0.1,
    )


CAMPAIGN = Campaign(
    title="t",
    stands_for="s",
    route="mixed_5km",
    laps=5,
    seed=0,
    fault_window_s=(60, 150),
    faults={
        "open": "rear_stroke:open",
        "uncalibration": "rear_stroke:uncalibration",
        "fork": "fork_stroke:open",
    },
)
RESULTS = [
    result(FAULT_FREE, Outcome.OK, 1),
    result(FAULT_FREE, Outcome.FA, 2),
    result(FAULT_FREE, Outcome.INVALID, 3, reason="frames lost", cycles=(9_999_999,)),
    result("open", Outcome.CD, 4, 1.0),
    result("open", Outcome.CD, 5, 3.0),
    result("open", Outcome.INVALID, 6, 50.0, reason="ECU overrun [pc 0x08000e6a]"),
    result("open", Outcome.MD, 7),
    result("open", Outcome.CD, 8, 2.0),
    result("uncalibration", Outcome.FA, 9),
]


def text(part):
    out = io.StringIO()
    Console(file=out, width=200).print(part, highlight=False)
    return out.getvalue()


def row(part, begin):
    """The cells of the one line of a table that begins with `begin`."""
    (line,) = [line for line in text(part).splitlines() if line.lstrip("│ ").startswith(begin)]
    return [cell.strip() for cell in line.strip("│").split("│")]


@pytest.fixture(scope="module")
def parts():
    return road(CAMPAIGN, RESULTS)


def test_invalid_first(parts):
    """Invalid runs come before any table, each with its condition, lap and reason word for word."""
    said = text(parts[0])
    assert "INVALID runs: 2 of 9, they enter no rate" in said
    assert "fault-free, lap 3: frames lost" in said
    assert "open, lap 6: ECU overrun [pc 0x08000e6a]" in said


def test_no_invalid():
    """Without invalid runs that is said first, too."""
    assert text(road(CAMPAIGN, RESULTS[:2])[0]) == "INVALID runs: none of 2\n"


def test_order(parts):
    """After them come performance, times to detect and step time."""
    titles = [text(part).splitlines()[0].strip() for part in parts[1:]]
    assert [title[:10] for title in titles] == ["Table V.14", "Table V.15", "Table V.13"]


def test_detection(parts):
    """Detections are counted over the valid runs, with Wilson's interval and the thesis's figure beside."""
    # 3 of 4: Wilson 30 to 95 %
    assert row(parts[1], "Open circuit") == ["Open circuit", "4", "75", "30-95", "1", "0", "0", "100"]
    assert row(parts[1], "Losing calibration")[1:] == ["1", "0", "0-79", "0", "1", "0", "95"]


def test_condition_without_a_figure(parts):
    """A condition of ours alone stands under its own name, without runs and without a published figure."""
    assert row(parts[1], "fork") == ["fork", "0", "-", "---", "0", "0", "0", "-"]
    assert row(parts[2], "fork")[-1] == "-, -"


def test_false_alarms(parts):
    """False alarms are counted on valid fault-free laps and bounded per hour ridden."""
    said = " ".join(text(parts[1]).split())
    assert "Fault-free: FA 50 % of 2 laps" in said
    assert "thesis 0 %" in said
    # one alarm in 0.2 h: 4.744 / 0.2
    assert "0.20 h ridden, at most 23.7 false alarms/h" in said


def test_times(parts):
    """Times to detect are those of correct detections in valid runs."""
    assert row(parts[2], "Open circuit") == ["Open circuit", "3", "2.00", "1.00", "2.00", "3.00", "0.4, 0.1"]
    assert row(parts[2], "Losing calibration") == [
        "Losing calibration", "0", "-", "-", "-", "-", "26.4, 3.8"
    ]  # fmt: skip


def test_steps():
    """Step times are pooled over the valid runs, in microseconds of the MCU's clock."""
    runs = [
        result(FAULT_FREE, Outcome.OK, 1, cycles=(5500, 5500)),
        result("open", Outcome.CD, 2, 1.0, cycles=(5500, 11000)),
        result("open", Outcome.INVALID, 3, cycles=(99_000,)),
    ]
    ours = row(road(CAMPAIGN, runs)[3], "this firmware")
    assert ours == ["this firmware", "22 MHz", "4", "312.5", "125.0", "250.0", "500.0"]


def test_steps_on_the_host():
    """The host core has no step time: the thesis's rows stand alone."""
    said = text(road(CAMPAIGN, [result(FAULT_FREE, Outcome.OK, hz=0)])[3])
    assert "this firmware" not in said
    assert "1851.6" in said


def test_step_times_beside(parts):
    """The thesis's step times stand beside, mean and deviation of each stage."""
    assert row(parts[3], "thesis, initial")[3:5] == ["1851.6", "7.0"]
    assert row(parts[3], "thesis, compiler")[3:5] == ["1628.0", "6.0"]
    assert row(parts[3], "thesis, final")[3:5] == ["686.6", "0.3"]


def test_nothing_ridden():
    """Tables of no run at all hold no figure of ours, and do not fail."""
    parts = road(CAMPAIGN, [])
    assert row(parts[1], "Open circuit")[1:4] == ["0", "-", "---"]
    assert "0.00 h ridden, at most nan" in " ".join(text(parts[1]).split())


def test_published_figures():
    """The shipped transcription of the thesis is the reference, word for word."""
    reference = SHARED / "reference" / "thesis.toml"
    if not reference.is_file():
        pytest.skip("the reference transcription is not beside this checkout")
    assert (HERE / "thesis.toml").read_bytes() == reference.read_bytes()


def test_published_figures_are_whole():
    """False alarms, detections and misses of each cell published sum to 100 % within rounding."""
    assert thesis() == tomllib.loads((Path(tables.__file__).parent / "thesis.toml").read_text("utf-8"))
    for table in thesis()["offline"].values():
        if isinstance(table, dict):
            for cells in zip(table["FA"], table["CD"], table["MD"], strict=True):
                for parts in zip(*cells, strict=True):
                    assert sum(parts) == pytest.approx(100, abs=0.3)
