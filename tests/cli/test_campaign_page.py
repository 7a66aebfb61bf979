"""A campaign's page: the JSON's figures, any trial's waveforms, nothing wrong when a browser opens it."""

import html
import json
import re
import shutil
import subprocess
from html.parser import HTMLParser

import pytest

pytest.importorskip("plotly", reason="plotly is not installed: pip install 'strokebench[report]'")

from bench.cli.campaign_page import campaign_page, difference_page
from bench.cli.campaign_trials import packed
from campaigns.differences import differences
from campaigns.export import document, road_tables
from campaigns.sheets import Cell, Sheet, at
from tests.campaigns.synthetic import CAMPAIGN, frame, row

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
BROWSER = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here: apt-get install chromium")

ROWS = [
    *(row("hold", "CD", k, 0.4 + 0.03 * k, "hold") for k in range(8)),
    row("hold", "MD", 8),
    row("hold", "INVALID", 9, reason="frames lost: <b>3</b>"),
    *(
        row(
            "uncalibration",
            "CD" if gain > 1.1 else "MD",
            k,
            2.0 if gain > 1.1 else None,
            parameters={"gain": gain},
        )
        for k in (10, 11)
        for gain in (1.05, 1.15, 1.2)
    ),
    row("fault-free", "OK", 20),
    row("fault-free", "FA", 21),
]
FRAME = frame("", 200)
TABLES = road_tables(ROWS, ["fault-free", "hold", "uncalibration"])
DOCUMENT = document(CAMPAIGN, TABLES, ROWS)
PUBLISHED = {"CD": {"hold": 100.0}, "TD_s": {"hold": [1.4, 0.2]}}


SHEET = Sheet("V.1", ["n", "L = 10 ms"], [[Cell("1"), Cell("97.7", marked=True)]], "grey: good")
PLOTS = [
    {"title": "SOE", "x": "tolerance", "y": "share", "lines": [{"name": "L", "x": [0, 1], "y": [1, 0]}]},
    {"figure": {"data": [{"type": "scatter", "x": [1], "y": [2]}], "layout": {"title": {"text": "own"}}}},
]


def without_plotly(text):
    """The page besides plotly.js."""
    start = text.index("/**\n* plotly.js")
    return text[:start] + text[text.index("</script>", start) :]


def make():
    """The page of everything at once: road trials, a sweep, a table and curves of the caller's own."""
    return campaign_page(
        DOCUMENT, lambda id_: None if id_ == ROWS[0].id else FRAME, PUBLISHED, [SHEET], PLOTS
    )


@pytest.fixture(scope="module")
def page():
    return make()


class Dom(HTMLParser):
    """What of a page matters here: figures by key, texts by id, how often a class was used."""

    def __init__(self, text):
        super().__init__()
        self.figures, self.texts, self.classes, self.rows, self._open = {}, {}, {}, [], []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        named = dict(attributes)
        for name in (named.get("class") or "").split():
            self.classes[name] = self.classes.get(name, 0) + 1
        if "data-key" in named:
            self.figures[named["data-key"]] = json.loads(named["data-value"])
        if "data-id" in named:
            self.rows.append(named)
        if tag not in ("meta", "input", "br", "link", "img"):
            self._open.append((tag, named.get("id")))

    def handle_endtag(self, tag):
        while self._open and self._open.pop()[0] != tag:
            pass

    def handle_data(self, data):
        for _, name in self._open:
            if name:
                self.texts[name] = self.texts.get(name, "") + data


def opened(text, folder, script="", anchor=""):
    """What Chromium makes of a page: its DOM once drawn, and what it said on its console.

    script: run after the page's own; it may click.
    """
    path = folder / "page.html"
    probe = f"<script>{script}; console.log('probe')</script></body>"
    path.write_text(text.replace("</body>", probe), encoding="utf-8")
    words = ["--headless=new", "--no-sandbox", "--disable-gpu", "--window-size=1400,2000"]
    words += [f"--user-data-dir={folder / 'profile'}", "--enable-logging=stderr", "--v=0"]
    words += ["--virtual-time-budget=4000", "--dump-dom", f"{path.as_uri()}{anchor}"]
    ended = subprocess.run([CHROMIUM, *words], capture_output=True, timeout=120, check=True)
    console = re.findall(r"CONSOLE[^\]]*\] (.*)", ended.stderr.decode(errors="replace"))
    return Dom(ended.stdout.decode()), console


def figures():
    """KEY.PATH -> value for everything a table of the page may show."""
    groups = [TABLES[name] for name in ("conditions", "fault_free", "curves", "steps")]
    return {group["key"]: group for part in groups for group in part}


@pytest.fixture(scope="module")
def seen(page, tmp_path_factory):
    """The page as a browser draws it, after a filter, an arrow key, and the address of another trial.

    Notes what each trial showed in #keyed, and the last one stays as it is.
    """
    script = f"""
    document.querySelector('.filters button[value="CD"]').click();
    const shown = [...document.querySelectorAll('#list tbody tr:not([hidden])')];
    shown[0].click();
    const down = new KeyboardEvent('keydown', {{key: 'ArrowDown', bubbles: true}});
    shown[0].querySelector('.pick').dispatchEvent(down);
    const note = document.body.appendChild(document.createElement('pre'));
    note.id = 'keyed';
    note.textContent = JSON.stringify({{
      second: shown[1].dataset.id, picked: document.querySelector('tr.picked').dataset.id,
      chosen: document.getElementById('chosen').textContent,
      instants: [...document.querySelectorAll('#instants td')].map((cell) => cell.textContent),
      lines: document.getElementById('wave').data.map((trace) => [trace.name, trace.y.length])}});
    location.hash = '{ROWS[0].id}'"""
    return opened(page, tmp_path_factory.mktemp("page"), script)


@BROWSER
def test_no_console_error(seen):
    """A browser has nothing to say about the page but what the test itself said."""
    _, console = seen
    assert [line for line in console if "probe" not in line] == []
    assert len(console) == 1


@BROWSER
def test_figures_equal_the_json(seen):
    """Every figure in the browser's tables is the one that stands in the JSON document under its key."""
    dom, _ = seen
    groups = figures()
    assert len(dom.figures) > 60
    for name, value in dom.figures.items():
        key = max((key for key in groups if name.startswith(f"{key}.")), key=len)
        assert at(groups[key], name.removeprefix(f"{key}.")) == value
    assert dom.figures["hold.CD"] == 8


@BROWSER
def test_drawn(seen):
    """Histogram, the caller's own curves, the detection curve and the waveform are drawn."""
    dom, _ = seen
    drawn = {name: re.sub(r"\s", "", dom.texts[name]) for name in ("histogram", "plot0", "plot1", "plot2")}
    for name, text in {"histogram": "missed", "plot0": "SOE", "plot1": "own", "plot2": "1.15"}.items():
        assert text in drawn[name]
    assert "uncalibration:correctdetectionsagainstgain" in drawn["plot2"]


@BROWSER
def test_filter(seen):
    """An outcome switched off leaves the list, and the count says so."""
    dom, _ = seen
    hidden = [named["data-outcome"] for named in dom.rows if "hidden" in named]
    assert set(hidden) == {"CD"}
    assert len(hidden) == 12
    assert dom.texts["shown"] == "6 of 18"


@BROWSER
def test_keyboard(seen):
    """The arrow key goes to the next trial shown: its waveforms, its instants."""
    keyed = json.loads(seen[0].texts["keyed"])
    assert keyed["picked"] == keyed["second"] == ROWS[-1].id
    assert keyed["chosen"] == "fault-free: no fault"
    assert keyed["instants"] == ["t_alarm", "alarm on the bus", "30.000", ""]
    assert keyed["lines"] == [["measured", 200], ["predicted", 200], ["residual", 200]]


@BROWSER
def test_address_of_a_trial(seen):
    """A trial's id behind the page's address opens it; one without a freeze frame says so."""
    dom, _ = seen
    assert dom.texts["chosen"] == "hold: rear_stroke:hold@60"
    assert dom.texts["about"].startswith("CD, alarm 0.4 s after the fault acted, named hold (seed 0")
    assert dom.texts["wave"] == "There is no freeze frame of this trial here."
    assert "alarm on the bus60.4000.400" in re.sub(r"\n", "", dom.texts["instants"])


@pytest.fixture(scope="module")
def difference():
    """The page of two stores of which two trials differ: one is lost, one found sooner."""
    after = [row("hold", "MD", 0, ecu="b"), row("hold", "CD", 1, 0.2, "hold", ecu="b")]
    before = [row("hold", "CD", 0, 0.4, "hold"), row("hold", "CD", 1, 0.43, "hold")]
    found = differences(before, after)
    trials = [
        tuple({"id": each.id, "trial": each.trial, "result": each.result} for each in pair)
        for pair in zip(before, after, strict=True)
    ]
    frames = (lambda _: FRAME), (lambda _: {**FRAME, "predicted_mm": FRAME["measured_mm"]})
    return difference_page(found, ("a.sqlite", "b.sqlite"), trials, frames, (CAMPAIGN, CAMPAIGN))


@BROWSER
def test_difference_drawn(difference, tmp_path):
    """A changed trial is drawn before and after; what is the same in both is drawn once."""
    dom, console = opened(difference, tmp_path)
    assert len(console) == 1
    assert "2 of 2 matched trials changed" in difference
    legend = re.sub(r"\s", "", dom.texts["wave"])
    for name in ("predicted,a.sqlite", "predicted,b.sqlite"):
        assert name in legend
    assert legend.count("measured") == 1
    assert len(dom.rows) == 2


def test_difference_names_what_changed(difference):
    """The list of changed trials says from what to what."""
    text = re.sub(r"<[^>]*>", "", without_plotly(difference))
    assert "CD → MD" in text
    assert "0.430 → 0.200" in text


def test_invalid_first(page):
    """What proves nothing stands before any table, with its reason."""
    assert 0 < page.index("INVALID runs: 1 of 18") < page.index("<table")
    assert "frames lost: &lt;b&gt;3&lt;/b&gt;" in page


def test_provenance(page):
    """The page tells what it was made with and the whole plan."""
    text = without_plotly(page)
    for known in ("f" * 64, "versions.numpy", "mixed_5km", "section V.6, Tables V.14 and V.15"):
        assert known in text


def test_published_beside(page):
    """The published figures stand in their own columns."""
    assert '<th scope="col">thesis CD %</th>' in page


def test_fetches_nothing(page, difference):
    """The page names nothing to be fetched, and forbids its scripts to."""
    for text in map(without_plotly, (page, difference)):
        assert "default-src 'none'" in text
        assert not re.search(r"""(src|href)\s*=\s*["']?(https?:)?//""", text)
        assert "https://" not in text


def test_plotly_once(page):
    """plotly.js is in the page once, whatever is drawn."""
    assert page.count("* plotly.js v") == 1


def test_same_page_again(page):
    """The same document and frames make the same bytes."""
    assert make() == page


def test_markup_is_text(tmp_path):
    """Names and reasons are text on the page, whatever they look like."""
    evil = "</script><script>alert(1)</script>"
    rows = [row("hold", "CD", 1, 0.5, evil, reason=evil, lap={"file": evil, "sha256": "0"})]
    text = campaign_page(
        document({**CAMPAIGN, "title": evil, "name": evil}, road_tables(rows), rows), lambda _: FRAME
    )
    assert "<script>alert" not in text
    assert html.escape(evil) in text
    assert json.loads(_data(text))["trials"][0]["about"].count(evil) == 3


def _data(text):
    return re.search(r'<script type="application/json" id="data">(.*?)</script>', text, re.DOTALL)[1]


def test_size():
    """A hundred trials of a thousand samples make a page below 15 MB."""
    rows = [row("hold", "CD", k, 0.5) for k in range(100)]
    long = frame("", 1000)
    text = campaign_page(document(CAMPAIGN, road_tables(rows), rows), lambda _: long)
    assert len(text.encode()) < 15_000_000
    assert len(json.loads(_data(text))["trials"][99]["sides"][0]["frame"]["series"]["residual"]) == 1000


def test_too_many_to_draw(monkeypatch):
    """Of very many trials those are drawn that did not end as they should, and the page says so."""
    monkeypatch.setattr("bench.cli.campaign_page.MOST_FRAMES", 3)
    text = campaign_page(DOCUMENT, lambda _: FRAME)
    drawn = {trial["id"] for trial in json.loads(_data(text))["trials"] if trial["sides"][0]["frame"]}
    wrong = {each.id for each in ROWS if each.result["outcome"] in ("INVALID", "FA")}
    assert len(drawn) == 3
    assert wrong <= drawn
    assert "Waveforms of 3 of 18 trials" in text


def test_packed():
    """A freeze frame is kept to the hundredth; where nothing was there is nothing."""
    measured = [41.237, 41.241, None, 40.0, float("nan"), 39.996]
    packed_frame = packed({**FRAME, "measured_mm": measured})
    back, total = [], 0
    for step in packed_frame["series"]["measured"]:
        total += step or 0
        back.append(None if step is None else total / 100)
    assert back == [41.24, 41.24, None, 40.0, None, 40.0]
    assert (packed_frame["t0"], packed_frame["dt"]) == (55.0, 0.01)


def test_other_campaigns():
    """A campaign of other trials shows the tables and curves it is given, and no trials."""
    text = campaign_page(document(CAMPAIGN, {"cells": {}}, []), sheets=[SHEET], plots=PLOTS)
    assert '<td class="marked">97.7</td>' in text
    assert json.loads(_data(text))["plots"] == PLOTS
    assert "<h2>Trials</h2>" not in text
    assert "<h2>Times to detect</h2>" not in text


def test_nothing_finished():
    """A store without a finished trial has a page, too."""
    text = campaign_page(document(CAMPAIGN, road_tables([]), []), lambda _: None)
    assert "INVALID runs: none of 0" in text
