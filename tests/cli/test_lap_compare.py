"""`bench lap compare`: which lap becomes which column, and that each figure stands in its row."""

import shutil

import numpy as np
import pytest

from bench.laps.files import write_lap
from bench.laps.lap import Lap
from tests.conftest import SHARED, wavy_lap

MAP = '[channels.fork_stroke_mm]\nsignal = "Fork"\nunit = "cm"\n'


@pytest.fixture
def laps(tmp_path):
    """A lap with all channels, the rear 100 ms after the fork at 36 km/h; and one with a sine of a fork."""
    rough = np.random.default_rng(0).standard_normal(33_000)
    rough = 50 + 4 * np.convolve(rough, np.hanning(40), "same")
    channels = wavy_lap(30.0).channels | {
        "fork_stroke_mm": rough[1000:31_000],
        "rear_stroke_mm": rough[900:30_900],
        "speed_kmh": np.full(30_000, 36.0),
    }
    t_ns = np.arange(30_000) * 1_000_000
    write_lap(Lap(t_ns, channels), tmp_path / "all.parquet")
    sine = 50 + 20 * np.sin(2 * np.pi * 3.0 * t_ns / 1e9)
    write_lap(Lap(t_ns, {"fork_stroke_mm": sine}), tmp_path / "fork.csv")
    return tmp_path / "all.parquet", tmp_path / "fork.csv"


def cells(out, section, name):
    """The cells of a row, in one list whatever block they were printed in; `section` '' for the head."""
    found, here = [], ""
    for line in map(str.rstrip, out.splitlines()):
        if line and not line.startswith(" ") and len(line.split("  ")) == 1:
            here = line.strip()
        elif line.strip().startswith(name) and here == section:
            found += line.strip().removeprefix(name).split()
        if not line:
            here = ""
    return found


def test_figures_stand_in_their_rows(bench, laps):
    """A sine's range, spread, top speed, share of time and band are where the table says."""
    out = bench("lap", "compare", laps[1], "--ascii").out
    assert cells(out, "", "duration s") == ["30.0"]
    assert cells(out, "", "rate Hz") == ["1000"]
    assert cells(out, "fork stroke", "range mm") == ["30.0-70.0"]
    assert cells(out, "fork stroke", "std mm") == ["14.14"]
    assert cells(out, "fork stroke", "fastest mm/s") == ["377"]  # 2 pi 3 20
    assert cells(out, "fork stroke", "under 400 mm/s %") == ["100.0"]
    assert cells(out, "fork stroke", "2-5 Hz rms mm, %") == ["14.14", "100.0"]
    assert cells(out, "fork stroke", "speed 1-10 Hz %") == ["100.0"]
    # arcsin(50 / 377) of a quarter turn
    bar, share = cells(out, "fork stroke", "0-50 mm/s %")
    assert (bar, float(share)) == ("#", pytest.approx(8.47, abs=0.2))


def test_what_a_lap_lacks_is_a_dash(bench, laps):
    """A lap without a channel has dashes there, the others their figures."""
    out = bench("lap", "compare", *laps).out
    assert cells(out, "rear stroke", "std mm")[1] == "-"
    assert cells(out, "rear stroke", "std mm")[0] != "-"
    assert cells(out, "rear after front", "delay ms") == ["100", "-"]
    assert cells(out, "1-10 Hz, % of power", "acc_body_ms2")[1] == "-"


def test_delay_times_speed(bench, laps):
    """100 ms at 36 km/h are a base of 1 m, found in every window."""
    out = bench("lap", "compare", laps[0]).out
    assert cells(out, "rear after front", "delay x speed m") == ["1.00"]
    assert cells(out, "rear after front", "windows that count") == ["5", "of", "5"]
    assert cells(out, "rear after front", "quartiles ms") == ["100,", "100"]


def test_as_many_columns_as_fit(bench, laps):
    """Five laps at 80 columns stand in two blocks, each with all rows, none wider than the pipe."""
    out = bench("lap", "compare", *[laps[1]] * 5).out
    assert max(map(len, out.splitlines())) <= 80
    assert out.count("duration s") == 2
    assert cells(out, "", "duration s") == ["30.0"] * 5


def test_folder_is_one_column(bench, laps, tmp_path):
    """A folder's laps are pooled: one column, named after the folder."""
    folder = tmp_path / "rides"
    folder.mkdir()
    for name in ("a.csv", "b.csv"):
        shutil.copy(laps[1], folder / name)
    (folder / "notes.txt").write_text("not a lap")
    out = bench("lap", "compare", folder, laps[1]).out
    assert out.split()[:2] == ["rides", "fork.csv"]
    assert cells(out, "", "laps") == ["2", "1"]
    assert cells(out, "", "duration s") == ["60.0", "30.0"]


def test_same_name_twice(bench, laps, tmp_path):
    """Files of one name in two folders are told apart by their paths."""
    (tmp_path / "b").mkdir()
    shutil.copy(laps[1], tmp_path / "b" / "fork.csv")
    out = bench("lap", "compare", laps[1], tmp_path / "b" / "fork.csv").out
    assert "".join(line.split()[-1] for line in out.split("laps")[0].splitlines()).endswith("b/fork.csv")


def test_map_for_those_that_need_it(bench, laps, tmp_path):
    """The map reads the file that has its signals; the other keeps its own names."""
    (tmp_path / "map.toml").write_text(MAP)
    t = np.arange(3000) / 100
    rows = "".join(f"{a:.2f},{5 + np.sin(a):.6f}\n" for a in t)
    (tmp_path / "bike.csv").write_text("t_s,Fork\n" + rows)
    ended = bench("lap", "compare", tmp_path / "bike.csv", laps[1], "--map", tmp_path / "map.toml")
    assert cells(ended.out, "fork stroke", "range mm") == ["40.0-60.0", "30.0-70.0"]


def test_damage_on_stderr(bench, tmp_path):
    """What was wrong with a lap, or mended, is said on the error stream."""
    t_ns = np.concatenate([np.arange(3000), np.arange(3010, 6000)]) * 1_000_000
    write_lap(Lap(t_ns, {"speed_kmh": np.ones(len(t_ns))}), tmp_path / "lap.csv")
    ended = bench("lap", "compare", tmp_path / "lap.csv", "--repair")
    assert ended.err.startswith(f"bench: lap: {tmp_path / 'lap.csv'}: ")
    assert "filled with 10 samples" in ended.err


def test_refuses_both_readings(refused, laps, tmp_path):
    """A file that neither the map nor its own names make a lap of is refused with both reasons."""
    (tmp_path / "map.toml").write_text(MAP)
    (tmp_path / "bad.csv").write_text("t_s,brake\n0,1\n1,2\n")
    says = refused("lap", "compare", laps[1], tmp_path / "bad.csv", "--map", tmp_path / "map.toml")
    assert "column Fork, mapped to fork_stroke_mm" in says
    assert "; without the map: " in says
    assert "unknown column 'brake'" in says


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("gone.csv",), "gone.csv: no such file"),
        (("gone.csv", "--map", "map.toml"), "gone.csv: no such file"),
        (("empty",), "empty: no lap in it (.csv, .parquet"),
        (("short.csv",), "short.csv: nowhere 64 samples without a gap"),
        (("fork.csv", "--html", "fork.csv"), "fork.csv: is the lap itself"),
        (("fork.csv", "--map", "none.toml"), "none.toml: cannot be read"),
    ],
)
def test_refuses(refused, laps, monkeypatch, words, says):
    """What cannot be compared is refused in one line."""
    folder = laps[0].parent
    monkeypatch.chdir(folder)
    (folder / "empty").mkdir()
    (folder / "map.toml").write_text(MAP)
    write_lap(Lap(np.arange(9) * 1_000_000, {"speed_kmh": np.ones(9)}), folder / "short.csv")
    assert says in refused("lap", "compare", *words)


def test_rates_in_a_folder(refused, tmp_path):
    """Laps of different rates are not pooled."""
    for rate in (100, 1000):
        t_ns = np.arange(500) * (1_000_000_000 // rate)
        write_lap(Lap(t_ns, {"speed_kmh": np.ones(500)}), tmp_path / f"{rate}.csv")
    assert "1000.csv: sampled at 1000 Hz, 100.csv at 100 Hz: not to be pooled" in refused(
        "lap", "compare", tmp_path
    )


def test_brackets_in_a_column(bench, tmp_path):
    """A name is shown as it is, not read as markup."""
    write_lap(wavy_lap(1.0), tmp_path / "a[red].csv")
    assert "a[red].csv" in bench("lap", "compare", tmp_path / "a[red].csv").out


def test_page(bench, laps, tmp_path):
    """The page has the table and each lap's curves and digest; made again, the same bytes."""
    for name in ("a.html", "b.html"):
        assert bench("lap", "compare", *laps, "--html", tmp_path / name).code == 0
    text = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert text == (tmp_path / "b.html").read_text(encoding="utf-8")
    text = text[text.index("</script>", text.index("plotly.js v")) :]
    assert text.count('"name":"all.parquet"') == 4
    assert text.count('"name":"fork.csv"') == 2
    assert "sha256 of the lap" in text


def test_page_of_a_name_with_markup(bench, tmp_path):
    """A lap's name is text in the page's table and legend."""
    path = tmp_path / "<b>&<script>.csv"
    write_lap(wavy_lap(1.0), path)
    bench("lap", "compare", path, "--html", tmp_path / "page.html")
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "<td>&lt;b&gt;&amp;&lt;script&gt;.csv</td>" in text
    assert '"name":"&lt;b&gt;&amp;&lt;script&gt;.csv"' in text


def test_recorded_beside_simulated(bench, laps):
    """A mountain bike's recording, which needs the map, stands beside a lap that needs none."""
    from bench.laps.sufni import MAPS

    path = SHARED / "data" / "sufni-mtb-sst" / "00648.SST"
    if not path.exists():
        pytest.skip(f"no recording {path.name}: it is not part of the repository")
    out = bench("lap", "compare", laps[0], path, "--map", MAPS / "clash2022.toml").out
    assert cells(out, "", "duration s") == ["30.0", "53.1"]
    assert cells(out, "fork stroke", "resolution mm")[1] == "0.32"
