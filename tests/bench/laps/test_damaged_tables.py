"""Tables that were cut short or damaged: a clear refusal, or exactly what the bytes still say."""

import numpy as np
import pytest

from bench.errors import LapError
from bench.laps import CHANNELS, Lap, read_lap, write_lap
from bench.laps.channel_map import ChannelMap, Row

EVERY = range(60)


def a_lap(samples=400):
    rng = np.random.default_rng(7)
    return Lap(np.arange(samples) * 1_000_000, {name: rng.standard_normal(samples) for name in CHANNELS})


def mutated(content, seed):
    """The bytes cut short, with bits flipped, a block zeroed, or a block twice."""
    rng = np.random.default_rng(seed)
    at, end = sorted(int(k) for k in rng.integers(0, len(content), 2))
    kind = seed % 4
    if kind == 0:
        return content[:at]
    if kind == 1:
        flipped = bytearray(content)
        for place in rng.integers(0, len(content), 1 + seed % 5):
            flipped[place] ^= 1 << int(rng.integers(8))
        return bytes(flipped)
    return content[:at] + (bytes(end - at) if kind == 2 else content[at:end] * 2) + content[end:]


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
@pytest.mark.parametrize("seed", EVERY)
def test_damaged_tables_are_refused_or_say_what_they_say(tmp_path, suffix, seed):
    """A damaged table is refused in one line that names it, or is a lap; nothing else is raised."""
    path = tmp_path / f"lap{suffix}"
    write_lap(a_lap(), path)
    content = path.read_bytes()
    path.write_bytes(mutated(content, seed))
    said, lap = "", None
    try:
        lap = read_lap(path)
    except LapError as refusal:
        said = str(refusal)
    if lap is None:
        assert str(path) in said
        assert "\n" not in said
        return
    # A row that is missing entirely cannot be seen in CSV but for the gap in time, which is told.
    lost = len(a_lap().t_ns) - len(lap.t_ns)
    assert suffix == ".csv" or lost == 0
    assert lost == 0 or lap.damage or lap.t_ns[-1] == (len(lap.t_ns) - 1) * 1_000_000


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_a_map_names_the_columns_of_a_table(tmp_path, suffix):
    """With a map a table of other names, units and more columns becomes a lap in the channels' units."""
    import pyarrow as pa
    import pyarrow.csv
    import pyarrow.parquet

    table = pa.table(
        {
            "Time": [0.0, 10.0, 20.0],
            "Front": [1.0, 2.0, 3.0],
            "v": [10.0, 10.0, 20.0],
            "note": ["a", "b", "c"],
        }
    )
    path = tmp_path / f"other{suffix}"
    (pa.csv.write_csv if suffix == ".csv" else pa.parquet.write_table)(table, path)
    rows = {
        "fork_stroke_mm": Row("fork_stroke_mm", "Front", "cm", 2.0, 1.0),
        "speed_kmh": Row("speed_kmh", "v", "m/s"),
    }
    lap = read_lap(path, ChannelMap("map.toml", rows, time=Row("t_s", "Time", "ms")))
    assert lap.t_ns.tolist() == [0, 10_000_000, 20_000_000]
    assert lap.channels["fork_stroke_mm"].tolist() == [21.0, 41.0, 61.0]
    assert lap.channels["speed_kmh"] == pytest.approx([36.0, 36.0, 72.0])
