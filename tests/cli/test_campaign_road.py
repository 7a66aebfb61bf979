"""`bench campaign run|resume|report` of road trials and offline campaigns: stores, files, refusals."""

import csv
import json
import sqlite3
import xml.etree.ElementTree as Xml
from contextlib import closing

import pytest

from campaigns.store import Store
from targets.host import library
from tests.campaigns.synthetic import frame, road_store, row
from tests.conftest import simulated_laps

PLAN = """
title = "Small trial"
stands_for = "a test"
route = "mixed_5km"
laps = 1
seed = 100
seconds = 6
fault_window_s = [2.5, 3]
faults = { open = "rear_stroke:open", held = "rear_stroke:hold" }
"""
OFFLINE = """
kind = "offline"
title = "Small offline campaign"
stands_for = "a test"
test = { route = "mixed_5km", count = 1, seed = 0 }
seed = 1
faults_per_kind = 3
L_ms = [20, 50]
n = [1, 2]
t_max_s = 3
feedback = ["predicted"]
compare = "gsxr1000_checks"
faults = { open = "rear_stroke:open" }
"""
ON = "host" if library() else "mcu"


@pytest.fixture
def plan(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "small.toml").write_text(PLAN)
    (tmp_path / "offline.toml").write_text(OFFLINE)
    return "small.toml"


@pytest.fixture(scope="module")
def laps(tmp_path_factory):
    """Two laps of one's own, 8 s long."""
    return simulated_laps(tmp_path_factory.mktemp("laps"), "mixed_5km", 8.0)


def run(bench, plan, *more):
    return bench("campaign", "run", plan, "--on", ON, "--workers", 1, *more)


def test_run_prints_and_stores(bench, plan, tmp_path):
    """A run prints its tables, invalid runs first, and leaves every trial in a store named after it."""
    said = run(bench, plan)
    assert said.code == 0, said.err
    assert said.out.index("INVALID runs: none of 3") < said.out.index("Diagnostic performance")
    assert said.out.index("open") < said.out.index("held")
    with Store.read(tmp_path / "small.sqlite") as store:
        assert len(store.ids()) == 3
    assert [path.name for path in tmp_path.glob("small.sqlite*")] == ["small.sqlite"]


def test_again_rides_nothing(bench, plan, monkeypatch):
    """The same command again takes everything from the store, and prints the same tables."""
    first = run(bench, plan)
    monkeypatch.setattr("campaigns.trial.RoadWork.__call__", lambda *_: pytest.fail("ridden again"))
    again = run(bench, plan)
    assert (again.code, again.out) == (0, first.out)
    assert "3 of 3 trials were in small.sqlite" in again.err


def test_resume_needs_a_store(refused, plan):
    """There must be something to resume."""
    line = refused("campaign", "resume", plan)
    assert line == "bench: campaign: small.sqlite: no such store to go on with\n"


def test_resume_runs_what_is_missing(bench, plan, tmp_path):
    """A store with some of the trials is completed to what an undisturbed run leaves."""
    run(bench, plan, "--store", "whole.sqlite")
    with Store.read(tmp_path / "whole.sqlite") as whole:
        campaign, rows = whole.campaign, list(whole.rows())
        expected, frames = whole.content_hash(), [whole.frame(row.id) for row in rows]
    with Store.open(tmp_path / "part.sqlite", campaign) as part:
        part.put(rows[0].id, rows[0].trial, rows[0].result, frames[0])
    # the campaign is named after its file, not after its store
    said = bench("campaign", "resume", plan, "--on", ON, "--workers", 1, "--store", "part.sqlite")
    assert said.code == 0, said.err
    with Store.read(tmp_path / "part.sqlite") as part:
        assert part.content_hash() == expected


def test_store_of_another_campaign(bench, refused, plan, tmp_path):
    """A store that another campaign began is refused, and left as it was."""
    run(bench, plan)
    (tmp_path / "small.toml").write_text(PLAN.replace("seed = 100", "seed = 101"))
    line = refused("campaign", "run", plan, "--on", ON, "--workers", 1)
    assert "small.sqlite: is the store of another campaign: plan.seed" in line


def test_every_output(bench, plan, tmp_path):
    """One run writes JSON, CSV, Parquet, JUnit XML and a page, whose figures are those of its tables."""
    pytest.importorskip("plotly", reason="plotly is not installed")
    names = ("json", "csv", "parquet", "junit", "html")
    said = run(bench, plan, "--ftti", 1, *(word for name in names for word in (f"--{name}", f"out.{name}")))
    assert said.code == 0, said.err
    document = json.loads((tmp_path / "out.json").read_text())
    assert [group["key"] for group in document["tables"]["conditions"]] == ["open", "held"]
    assert document["tables"]["conditions"][0]["ftti"]["ftti_s"] == 1
    assert len(document["trials"]) == 3
    assert len((tmp_path / "out.csv").read_text().splitlines()) == 4
    assert (tmp_path / "out.parquet").read_bytes()[:4] == b"PAR1"
    cases = Xml.parse(tmp_path / "out.junit").getroot().iter("testcase")
    assert len(list(cases)) == 3
    assert 'data-key="open.CD"' in (tmp_path / "out.html").read_text()


def test_report_of_a_store(bench, plan):
    """A store's tables are printed again from the file alone."""
    first = run(bench, plan)
    assert bench("campaign", "report", "small.sqlite").out == first.out


def test_report_against_another_store(bench, plan, tmp_path):
    """Two detectors on the same laps: which verdicts changed, on the terminal, as JSON, as a page."""
    pytest.importorskip("plotly", reason="plotly is not installed")
    run(bench, plan)
    run(bench, plan, "--model", "gsxr1000_checks", "--store", "checks.sqlite")
    outs = ("--json", "diff.json", "--html", "diff.html")
    said = bench("campaign", "report", "checks.sqlite", "--against", "small.sqlite", *outs)
    assert said.code == 0, said.err
    found = json.loads((tmp_path / "diff.json").read_text())
    assert found["matched"] == 3
    named = {change["condition"]: change["named"] for change in found["changed"]}
    assert named == {"open": [None, "open"], "held": [None, "hold"]}
    assert "<h2>Changed trials</h2>" in (tmp_path / "diff.html").read_text()


def test_tolerance(bench, plan, tmp_path):
    """Times to detect that differ by no more than --tolerance are no change."""
    run(bench, plan)
    run(bench, plan, "--model", "gsxr1000_checks", "--store", "checks.sqlite")
    words = ("campaign", "report", "checks.sqlite", "--against", "small.sqlite", "--json", "diff.json")
    for tolerance, times in (((), True), (("--tolerance", 100), False)):
        assert bench(*words, *tolerance).code == 0
        found = json.loads((tmp_path / "diff.json").read_text())
        assert any("td_s" in change["what"] for change in found["changed"]) == times


def test_fail_fast(bench, plan, tmp_path):
    """With --fail-fast a verdict that fails ends the run with exit code 1, and the store keeps it."""
    (tmp_path / "small.toml").write_text(PLAN.replace('"rear_stroke:open"', '"fork_stroke:open"'))
    said = run(bench, plan, "--fail-fast")
    assert said.code == 1
    assert "failed; 1 not begun" in said.err
    with Store.read(tmp_path / "small.sqlite") as store:
        assert len(store.ids()) == 2


def test_laps_of_ones_own(bench, plan, laps, tmp_path):
    """Laps of a folder are ridden instead of simulated ones, every file once without a fault."""
    said = run(bench, plan, "--laps", laps, "--json", "out.json")
    assert said.code == 0, said.err
    trials = json.loads((tmp_path / "out.json").read_text())["trials"]
    assert sorted(trial["trial"]["lap"]["file"] for trial in trials)[0] == "1.parquet"
    assert len(trials) == 4


def test_lap_shorter_than_the_insertion_time(refused, plan, laps, tmp_path):
    """A lap that ends before the faults come is named with both times."""
    (tmp_path / "small.toml").write_text(PLAN.replace("[2.5, 3]", "[20, 30]").replace("seconds = 6", ""))
    line = refused("campaign", "run", plan, "--laps", laps)
    assert ".parquet: 7.999 s long, but the faults come from 20 s on" in line


def test_offline_campaign(bench, plan, tmp_path):
    """An offline campaign prints its tables with the detectors compared, and goes on from its store."""
    words = ("campaign", "run", "offline.toml", "--workers", 1, "--json", "out.json")
    first = bench(*words)
    assert first.code == 0, first.err
    assert "Correct Detection percentage" in first.out
    assert "Detectors compared" in first.out
    tables = json.loads((tmp_path / "out.json").read_text())["tables"]
    assert {one["detector"] for one in tables["compared"]} >= {"second detector", "two-sided CUSUM"}
    assert bench(*words).out == first.out


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("run", "small.toml", "--workers", 0), "--workers is 0; it must be at least 1"),
        (("run", "small.toml", "--model", "none.json"), "none.json: no such file"),
        (("run", "small.toml", "--cluster", "tcp://127.0.0.1:1"), "127.0.0.1:1"),
        (("run", "offline.toml", "--junit", "x.xml"), "a campaign of kind offline takes no --junit"),
        (
            ("run", "offline.toml", "--on", "mcu", "--ftti", 1),
            "of kind offline takes no --on, --ftti",
        ),
        (("run", "small.toml", "--repair"), "--map and --repair go with --laps"),
        (("resume", "narx_performance"), "narx_performance: keeps no store to go on with"),
        (("report", "none.sqlite"), "none.sqlite: no such file"),
        (("report", "small.toml"), "small.toml"),
    ],
)
def test_refusals(refused, plan, words, says):
    """What cannot be done is refused in one line before anything is ridden or written."""
    assert says in refused("campaign", *words)


NAMES = ("open [red]<b>&\"'", "[/]")


def test_names_that_mean_something_elsewhere(bench, plan, laps, tmp_path):
    """Markup of terminals, pages and XML in a name is shown as it is written, and steers no terminal."""
    pytest.importorskip("plotly", reason="plotly is not installed")
    folder = tmp_path / "odd"
    folder.mkdir()
    (folder / "a\n\x1b[31m<b>.parquet").write_bytes((laps / "1.parquet").read_bytes())
    faults = ", ".join(f"{json.dumps(name)} = 'rear_stroke:open'" for name in NAMES)
    text = PLAN.replace("seconds = 6", "").replace('"Small trial"', '"[/]<b>"')
    (tmp_path / "small.toml").write_text(text[: text.index("faults =")] + f"faults = {{ {faults} }}\n")
    outs = [word for name in ("csv", "junit", "html") for word in (f"--{name}", f"out.{name}")]
    said = run(bench, plan, "--laps", folder, *outs)
    assert said.code == 0, said.err
    assert "\x1b" not in said.out
    assert said.out.startswith("[/]<b>: a test\n")
    assert all(name in said.out for name in NAMES)
    with (tmp_path / "out.csv").open(newline="") as file:
        assert {row["condition"] for row in csv.DictReader(file)} == {"fault-free", *NAMES}
    suites = {suite.get("name") for suite in Xml.parse(tmp_path / "out.junit").iter("testsuite")}
    assert suites == {"fault-free", *NAMES}
    page = (tmp_path / "out.html").read_text()
    assert "&lt;b&gt;" in page
    assert "<b>&\"'" not in page


@pytest.fixture
def stores(tmp_path, monkeypatch):
    """Two stores of one campaign's file that have no trial in common."""
    monkeypatch.chdir(tmp_path)
    for k, name in enumerate(("a.sqlite", "b.sqlite")):
        road_store(tmp_path / name, [row("hold", "CD", k, 0.4)], frame(0))


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--json", "a.sqlite"), "a.sqlite: is the store itself"),
        (("--against", "b.sqlite", "--html", "b.sqlite"), "b.sqlite: is the store itself"),
        (("--against", "b.sqlite"), "a.sqlite: has no trial in common with b.sqlite"),
        (("--against", "a.sqlite", "--csv", "x.csv"), "--against takes --tolerance, --json and --html alone"),
        (("--against", "a.sqlite", "--ftti", "1"), "--against takes --tolerance, --json and --html alone"),
        (("--against", "a.sqlite", "--tolerance", "nan"), "a tolerance of nan s; it must be at least 0"),
        (("--against", "a.sqlite", "--tolerance", "-1"), "a tolerance of -1 s; it must be at least 0"),
        (("--tolerance", "1"), "--tolerance goes with --against"),
        (("--ftti", "nan"), "--ftti is nan; it must be more than 0"),
        (("--ftti", "0"), "--ftti is 0; it must be more than 0"),
    ],
)
def test_report_refusals(refused, stores, words, says):
    """A report that cannot be made is refused in one line, and no store is touched."""
    pytest.importorskip("plotly", reason="plotly is not installed")
    assert says in refused("campaign", "report", "a.sqlite", *words)


def test_damaged_frame_leaves_no_file(refused, stores):
    """Where a freeze frame turns out to be damaged, nothing was printed or written before."""
    pytest.importorskip("plotly", reason="plotly is not installed")
    with closing(sqlite3.connect("a.sqlite")) as connection, connection:
        connection.execute("UPDATE trials SET frame = x'00'")
    line = refused("campaign", "report", "a.sqlite", "--csv", "out.csv", "--html", "out.html")
    assert "a.sqlite: is damaged: the freeze frame of trial" in line
