"""Channel maps: what a map may say, what it makes of a file's values, and how a wrong one is refused."""

import math

import numpy as np
import pytest

from bench.errors import LapError
from bench.laps import read_lap
from bench.laps.channel_map import UNITS, Row, load_map
from dbc import CHANNELS

FORK = '[channels.fork_stroke_mm]\nsignal = "Fork"\n'


def load(tmp_path, text):
    path = tmp_path / "map.toml"
    path.write_text(text, encoding="utf-8")
    return load_map(path)


def test_a_whole_map(tmp_path):
    """Every key of a map arrives; the DBC's path is beside the map."""
    text = 'dbc = "bike.dbc"\nrate_hz = 500\n[time]\nsignal = "Time"\nunit = "ms"\n' + FORK
    found = load(tmp_path, text + 'unit = "cm"\nscale = -2\noffset = 0.5\nbus = 1\n')
    assert found.rows == {"fork_stroke_mm": Row("fork_stroke_mm", "Fork", "cm", -2.0, 0.5, 1)}
    assert (found.dbc, found.rate_hz) == (tmp_path / "bike.dbc", 500.0)
    assert found.time == Row("t_s", "Time", "ms")


def test_a_map_needs_no_more_than_a_signal(tmp_path):
    """What is left out is unscaled, unshifted, in the file's unit, on any bus, at the file's rate."""
    found = load(tmp_path, FORK)
    assert found.rows["fork_stroke_mm"] == Row("fork_stroke_mm", "Fork", None, 1.0, 0.0, None)
    assert (found.dbc, found.rate_hz, found.time) == (None, None, None)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", r"no \[channels\.NAME\]; the known ones are fork_stroke_mm"),
        ("channels = 3\n", r"no \[channels\.NAME\]"),
        ("[channels]\n", r"no \[channels\.NAME\]"),
        ("rate = 100\n" + FORK, "unknown key rate; the known ones are dbc, rate_hz, time, channels"),
        ("rate_hz = 0.5\n" + FORK, "rate_hz is 0.5, not from 1 to 100000"),
        ("rate_hz = inf\n" + FORK, "rate_hz is inf, not a finite number"),
        ("rate_hz = true\n" + FORK, "rate_hz is True, not a finite number"),
        ("dbc = 7\n" + FORK, "dbc is 7, not a file's name"),
        (
            '[channels.roll_deg]\nsignal = "x"\n',
            "unknown channel roll_deg; the known ones are fork_stroke_mm",
        ),
        ("[channels]\nfork_stroke_mm = 3\n", r"channels\.fork_stroke_mm is 3, not a table"),
        ("[channels.fork_stroke_mm]\n", r"channels\.fork_stroke_mm: signal is None, not a signal's name"),
        (FORK.replace('"Fork"', '""'), "signal is '', not a signal's name"),
        (FORK + 'unit = "V"\n', "unknown unit 'V'; fork_stroke_mm can come from mm, cm, m, um, in"),
        (FORK + "scale = 0\n", "scale is 0"),
        (FORK + "scale = nan\n", "scale is nan, not a finite number"),
        (FORK + 'offset = "1"\n', "offset is '1', not a finite number"),
        (FORK + "bus = 1.5\n", "bus is 1.5, not a whole number"),
        (FORK + "bus = true\n", "bus is True, not a whole number"),
        (
            FORK + "factor = 2\n",
            r"channels\.fork_stroke_mm: unknown key factor; the known ones are signal, unit",
        ),
        ('[time]\nunit = "ms"\n' + FORK, r"\[time\]: signal is None"),
        (
            '[time]\nsignal = "T"\nunit = "h"\n' + FORK,
            "unknown unit 'h'; t_s can come from s, ms, us, ns, min",
        ),
        ("[channels", "not TOML"),
    ],
)
def test_a_map_that_cannot_be_meant_is_refused(tmp_path, text, says):
    """The file, the key and the value at fault stand in one line."""
    with pytest.raises(LapError, match=says) as refusal:
        load(tmp_path, text)
    assert str(refusal.value).startswith(str(tmp_path / "map.toml"))
    assert "\n" not in str(refusal.value)


def test_a_map_that_is_not_there_is_refused(tmp_path):
    """A missing file is named."""
    with pytest.raises(LapError, match=r"none\.toml: cannot be read: No such file"):
        load_map(tmp_path / "none.toml")


@pytest.mark.parametrize(
    ("channel", "unit", "value", "expected"),
    [
        ("fork_stroke_mm", "in", 2.0, 50.8),
        ("pitch_rate_dps", "rad/s", math.pi, 180.0),
        ("pitch_rate_dps", "mrad/s", 1000 * math.pi, 180.0),
        ("speed_kmh", "m/s", 10.0, 36.0),
        ("speed_kmh", "mph", 100.0, 160.9344),
        ("acc_body_ms2", "mg", 1000.0, 9.80665),
        ("t_s", "min", 2.0, 120.0),
    ],
)
def test_units_become_the_channels(channel, unit, value, expected):
    """A value in a known unit becomes what it is in the channel's."""
    converted = Row(channel, "x", unit).convert(np.array([value]), None, "a.log")
    assert converted.tolist() == pytest.approx([expected], rel=1e-15)


def test_scale_and_offset_act_in_the_channels_unit():
    """Channel = signal in the channel's unit, times scale, plus offset."""
    assert Row("fork_stroke_mm", "x", "cm", 2.0, 5.0).convert(np.array([3.0]), None, "").tolist() == [65.0]


def test_the_maps_unit_goes_before_the_files():
    """Where both say a unit the map is right; where none does, the signal is refused by name."""
    row = Row("fork_stroke_mm", "x", "cm")
    assert row.convert(np.array([1.0]), "m", "a.log").tolist() == [10.0]
    for unit, says in ((None, "no unit in the file or the map"), (" V ", "unit 'V'")):
        with pytest.raises(LapError, match=rf"a\.log: signal x: {says}; fork_stroke_mm can come from mm"):
            Row("fork_stroke_mm", "x").convert(np.array([1.0]), unit, "a.log")


def test_every_channel_has_a_unit_of_its_own():
    """Each channel's ending is known, and one of its units is the channel's."""
    for name in CHANNELS:
        assert 1.0 in UNITS[name.rsplit("_", 1)[1]].values()


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_a_table_is_read_through_a_map(tmp_path, suffix):
    """Columns of any name and unit become channels, the time column too; the others are left alone."""
    import pyarrow as pa
    import pyarrow.csv
    import pyarrow.parquet

    table = pa.table({"ms": [0.0, 10.0, 20.0], "Gabel": [1.0, 2.0, 3.0], "note": ["a", "b", "c"]})
    path = tmp_path / f"ride{suffix}"
    pa.csv.write_csv(table, path) if suffix == ".csv" else pa.parquet.write_table(table, path)
    text = '[time]\nsignal = "ms"\nunit = "ms"\n' + FORK.replace("Fork", "Gabel") + 'unit = "cm"\n'
    lap = read_lap(path, load(tmp_path, text))
    assert lap.t_ns.tolist() == [0, 10_000_000, 20_000_000]
    assert lap.channels["fork_stroke_mm"].tolist() == [10.0, 20.0, 30.0]


def test_a_column_that_is_missing_is_named(tmp_path):
    """The message says what the map wanted and what the file has."""
    (tmp_path / "ride.csv").write_text("t_s,Gabel\n0,1\n1,2\n")
    with pytest.raises(
        LapError, match=r"column Fork, mapped to fork_stroke_mm by .*, is not there; .* t_s, Gabel"
    ):
        read_lap(tmp_path / "ride.csv", load(tmp_path, FORK))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (FORK.replace("Fork", "Gabel"), "ride.csv: signal Gabel: no unit in the file or the map"),
        (FORK.replace("Fork", "t_s") + 'unit = "mm"\n', "column t_s is mapped twice"),
        (FORK.replace("Fork", "twice") + 'unit = "mm"\n', "column twice, mapped to .*, appears twice"),
    ],
)
def test_a_map_that_does_not_fit_its_table_is_refused(tmp_path, text, says):
    """A unit nobody says and columns that are mapped or there twice are named."""
    (tmp_path / "ride.csv").write_text("t_s,Gabel,twice,twice\n0,1,2,3\n1,2,3,4\n")
    with pytest.raises(LapError, match=says):
        read_lap(tmp_path / "ride.csv", load(tmp_path, text))
