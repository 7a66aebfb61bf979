"""`bench lap show`: numbers, drawing and page of one lap."""

import re

import numpy as np
import pytest

from bench.laps.files import read_lap, write_lap
from bench.laps.lap import Lap
from tests.conftest import wavy_lap


@pytest.fixture
def page(bench, tmp_path):
    """Make a page of a lap and return what is written besides plotly.js."""

    def make(lap, *words):
        ended = bench("lap", "show", lap, "--html", tmp_path / "page.html", *words)
        assert (ended.code, ended.err) == (0, "")
        text = (tmp_path / "page.html").read_text(encoding="utf-8")
        start = text.index("/**\n* plotly.js")
        return text[:start] + text[text.index("</script>", start) :]

    return make


def test_head_and_statistics(bench, tmp_path):
    """Duration, rate, the largest gap and where, the digest's beginning, and each channel's statistics."""
    t_ns = np.array([0, 1, 2, 3, 8, 9]) * 1_000_000
    lap = Lap(t_ns, {"fork_stroke_mm": np.array([3.0, 4, 3, 4, 3, 4])})
    write_lap(lap, tmp_path / "lap.csv")
    lines = bench("lap", "show", tmp_path / "lap.csv").out.splitlines()
    assert lines[0] == (
        f"lap.csv: 0.009 s, 6 samples, 1000 Hz, largest gap 5 ms at 0.003 s, sha256 {lap.digest()[:12]}"
    )
    table = [line.split() for line in lines]
    assert ["channel", "min", "mean", "max", "rms", "std", "unit"] in table
    # rms of 3 and 4 in equal parts: sqrt(12.5)
    assert ["fork_stroke_mm", "3.00", "3.50", "4.00", "3.54", "0.50", "mm"] in table


def test_damage_is_printed(bench, tmp_path):
    """What is wrong with a lap stands below its head; repaired, what was mended."""
    t_ns = np.concatenate([np.arange(50), np.arange(60, 100)]) * 1_000_000
    write_lap(Lap(t_ns, {"speed_kmh": t_ns / 1e6}), tmp_path / "lap.csv")
    for words in ((), ("--repair",)):
        ended = bench("lap", "show", tmp_path / "lap.csv", *words)
        damage = read_lap(tmp_path / "lap.csv", repair=bool(words)).damage
        assert ended.out.splitlines()[1 : 1 + len(damage)] == [f"damage: {line}" for line in damage]
        assert ended.err == ""


def test_fits_a_pipe(bench, lap):
    """In a pipe all seven channels are drawn at 80 columns, in braille and without colours."""
    ended = bench("lap", "show", lap)
    lines = ended.out.splitlines()[2:]
    assert max(map(len, lines)) == 80
    assert "\x1b" not in ended.out
    assert any(0x2800 < ord(c) < 0x2900 for c in ended.out)
    for name in read_lap(lap).channels:
        assert sum(line.startswith(f"{name}, ") for line in lines) == 1


def test_ascii(bench, lap):
    """--ascii prints nothing but ASCII."""
    assert bench("lap", "show", lap, "--ascii").out.isascii()


def test_section_and_channel(bench, lap):
    """--from, --to and --channel narrow table and drawing; the head is still the whole lap's."""
    out = bench("lap", "show", lap, "--from", 1, "--to", 2, "--channel", "speed_kmh").out
    assert out.startswith("lap.csv: 2.999 s, 3000 samples")
    assert "shown: 1 to 2 s, 1001 samples" in out
    assert "fork_stroke_mm" not in out
    values = read_lap(lap).channels["speed_kmh"][1000:2001]
    assert f"{values.min():.2f}" in out
    assert re.search(r"^ +1\.0 .* 2\.0 s$", out.splitlines()[-1])


def test_map(bench, tmp_path):
    """--map says which column is which channel."""
    (tmp_path / "bike.csv").write_text("t_s,Fork\n0,1.5\n0.01,2.5\n0.02,3.5\n")
    (tmp_path / "map.toml").write_text('[channels.fork_stroke_mm]\nsignal = "Fork"\nunit = "cm"\n')
    out = bench("lap", "show", tmp_path / "bike.csv", "--map", tmp_path / "map.toml").out
    assert ["fork_stroke_mm", "15.00", "25.00", "35.00"] in [line.split()[:4] for line in out.splitlines()]


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--from", 2, "--to", 1), "--from 2 is not before --to 1"),
        (("--from", "nan"), "--from nan is not before --to inf"),
        (("--from", 50), "lap.csv: 0 samples from 50 to inf s; the lap goes from 0 to 2.999 s"),
        (("--channel", "brake"), "lap.csv: no channel brake; it has fork_stroke_mm, rear_stroke_mm"),
        (("--map", "none.toml"), "none.toml: cannot be read"),
        (("--html", "nowhere/page.html"), "nowhere/page.html: no folder nowhere"),
        (("--html", "lap.csv"), "lap.csv: is the lap itself"),
    ],
)
def test_refuses(refused, lap, monkeypatch, words, says):
    """What cannot be shown is refused in one line, and nothing is written."""
    monkeypatch.chdir(lap.parent)
    assert says in refused("lap", "show", lap, *words)


def test_no_such_lap(refused, tmp_path):
    """A missing file is one line."""
    assert refused("lap", "show", tmp_path / "gone.csv").endswith("gone.csv: no such file\n")


def test_page_without_plotly(refused, lap, tmp_path, monkeypatch):
    """Without plotly a page is refused with the command that mends it, before the lap is read."""
    monkeypatch.setattr("bench.cli.page.find_spec", lambda _: None)
    says = refused("lap", "show", lap.with_name("gone.csv"), "--html", tmp_path / "page.html")
    assert says.endswith("page.html: needs plotly: pip install 'strokebench[report]'\n")


def test_page_says_what_the_terminal_says(page, lap):
    """The page has the head, the table, the whole digest and the versions."""
    text, ridden = page(lap), read_lap(lap)
    assert "3000 samples, 1000 Hz" in text
    assert ridden.digest() in text
    for name in ridden.channels:
        assert f"<td>{name}</td>" in text
    from bench.provenance import versions

    assert ", ".join(f"{name} {version}" for name, version in versions().items()) in text


def test_page_fetches_nothing(page, lap):
    """The page names nothing to be fetched, and forbids its scripts to."""
    text = page(lap)
    assert "default-src 'none'" in text
    assert not re.search(r"""(src|href)\s*=\s*["']?(https?:)?//""", text)
    assert "https://" not in text


def test_page_is_the_same_again(bench, lap, tmp_path):
    """The same lap makes the same bytes."""
    for name in ("a.html", "b.html"):
        bench("lap", "show", lap, "--html", tmp_path / name)
    assert (tmp_path / "a.html").read_bytes() == (tmp_path / "b.html").read_bytes()


def test_page_of_a_name_with_markup(page, tmp_path):
    """A lap's name is text in the page, whatever it looks like."""
    path = tmp_path / "<script>alert(1)<b>&.csv"
    write_lap(wavy_lap(1.0, ("speed_kmh",)), path)
    text = page(path)
    assert "<script>alert" not in text
    assert "&lt;script&gt;alert(1)&lt;b&gt;&amp;.csv" in text


def test_page_of_a_long_lap(page, tmp_path):
    """Five minutes at 1 kHz in seven channels make at most 3 MB beside plotly.js."""
    lap = wavy_lap(300.0)
    write_lap(lap, tmp_path / "lap.parquet")
    text = page(tmp_path / "lap.parquet")
    assert len(text) < 3_000_000
    assert "lowest and highest value of every 30 ms" in text


def test_page_is_whole_or_not_at_all(bench, lap, tmp_path, monkeypatch):
    """A page that cannot be finished leaves what was there before."""
    out = tmp_path / "page.html"
    out.write_text("before")

    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("pathlib.Path.write_text", full)
    ended = bench("lap", "show", lap, "--html", out)
    assert ended.code == 2
    assert ended.err == f"bench: record: {out}: cannot be written: no space left on device\n"
    assert out.read_text() == "before"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["lap.csv", "page.html"]


def test_gap_is_a_gap_in_the_page(tmp_path):
    """Where nothing was recorded a point that is none breaks the line."""
    pytest.importorskip("plotly")
    from bench.cli.page import _courses

    t_ns = np.concatenate([np.arange(50), np.arange(90, 100)]) * 1_000_000
    (course,) = _courses(Lap(t_ns, {"speed_kmh": np.ones(60)})).data
    assert np.flatnonzero(np.isnan(course.y)).tolist() == [50]
    assert len(course.x) == len(course.y) == 61


def test_reduced_course_keeps_the_peaks():
    """A long lap's course has the extremes of the whole."""
    pytest.importorskip("plotly")
    from bench.cli.page import _courses

    values = np.random.default_rng(0).standard_normal(100_000)
    (course,) = _courses(Lap(np.arange(100_000) * 1_000_000, {"speed_kmh": values})).data
    assert len(course.y) == 20_000
    assert (course.y.min(), course.y.max()) == pytest.approx((values.min(), values.max()))
    assert course.x0 + course.dx * len(course.y) == pytest.approx(99.999)
