"""ArduPilot's DataFlash logs, against pymavlink as an independent reader."""

import struct

import numpy as np
import pytest

from bench.errors import LapError
from bench.laps import CHANNELS, Lap, read_lap, write_lap
from bench.laps.channel_map import load_map
from bench.laps.mavlink.dataflash import _LABELS
from bench.laps.mavlink.records import FMT, Definition, definition_record, head

IMU = Definition(150, "IMU", "QBfffHc", ("TimeUS", "I", "GyrX", "GyrY", "AccZ", "Err", "Spd"))
UNIT = Definition(151, "UNIT", "QbZ", ("TimeUS", "Id", "Label"))
MULT = Definition(152, "MULT", "Qbd", ("TimeUS", "Id", "Mult"))
FMTU = Definition(153, "FMTU", "QBNN", ("TimeUS", "FmtType", "UnitIds", "MultIds"))
ISBD = Definition(154, "ISBD", "QHaZ", ("TimeUS", "N", "x", "Note"))
OLD = Definition(155, "CTUN", "Ih", ("TimeMS", "ThrIn"))
ITSELF = Definition(FMT, "FMT", "BBnNZ", ("Type", "Length", "Name", "Format", "Columns"))


def a_lap(samples=200, names=CHANNELS):
    rng = np.random.default_rng(4)
    return Lap(np.arange(samples) * 1_000_000 + 5_000, {name: rng.standard_normal(samples) for name in names})


def record(definition, *values):
    return np.array((head(definition.kind), *values), definition.layout()).tobytes()


def definitions(*those):
    return [definition_record(one) for one in (ITSELF, *those)]


def told():
    """Units and multipliers as ArduPilot logs them: GyrY in rad/s, Err in millimetres, I the instance."""
    return [
        *(record(UNIT, 0, ord(c), text) for c, text in (("E", b"rad/s"), ("m", b"m"), ("n", b"m/s"))),
        *(record(MULT, 0, ord(c), factor) for c, factor in (("-", 0.0), ("C", 1e-3), ("B", 1e-2))),
        record(FMTU, 0, IMU.kind, b"s#EEomn", b"F---0CB"),
    ]


def imu(k, instance=0):
    return record(IMU, 10_000 * (k + 1), instance, 0.0, 0.01 * k + instance, 9.8, 7 * k, 150 + k)


def log(tmp_path, *records):
    path = tmp_path / "00000042.bin"
    path.write_bytes(b"".join(records))
    return path


def ride(tmp_path, *records, extra=()):
    return log(tmp_path, *definitions(IMU, UNIT, MULT, FMTU, *extra), *told(), *records)


def read(tmp_path, path, signal, channel="pitch_rate_dps", more=""):
    (tmp_path / "map.toml").write_text(f'[channels.{channel}]\nsignal = "{signal}"\n{more}')
    return read_lap(path, load_map(tmp_path / "map.toml"))


def test_a_lap_comes_back_exactly(tmp_path):
    """Values come back bit for bit, times to the microsecond, uneven steps as they were."""
    rng = np.random.default_rng(0)
    t_ns = np.cumsum(rng.integers(1_000, 3_000_000, 300))
    lap = Lap(t_ns, {"rear_stroke_mm": rng.uniform(0, 110, 300), "acc_body_ms2": np.full(300, -0.0)})
    write_lap(lap, tmp_path / "lap.bin")
    back = read_lap(tmp_path / "lap.bin")
    assert np.abs(back.t_ns - t_ns).max() <= 500
    assert {n: v.tobytes() for n, v in back.channels.items()} == {
        n: v.tobytes() for n, v in lap.channels.items()
    }


def test_whole_microseconds_give_the_same_lap(tmp_path):
    """A lap at 1 kHz comes back equal, and nothing is said of it."""
    write_lap(a_lap(), tmp_path / "lap.bin")
    back = read_lap(tmp_path / "lap.bin")
    assert back == a_lap()
    assert back.damage == ()


def test_every_channel_has_a_label():
    """All that a lap may hold can be written, and the labels fit the 64 bytes that a definition has."""
    assert set(_LABELS) == set(CHANNELS)
    assert len(",".join(("TimeUS", *_LABELS.values()))) <= 64


def test_pymavlink_reads_what_is_written(tmp_path):
    """An independent reader finds every sample, and the units that the channels have."""
    reader = pytest.importorskip("pymavlink.DFReader", reason="pymavlink is not installed")
    lap = a_lap(50)
    write_lap(lap, tmp_path / "lap.bin")
    records = reader.DFReader_binary(str(tmp_path / "lap.bin"))
    rows = []
    while (message := records.recv_match(type="LAP")) is not None:
        rows.append([message.TimeUS * 1000, *(getattr(message, label) for label in _LABELS.values())])
    np.testing.assert_array_equal(rows, np.column_stack((lap.t_ns, *lap.channels.values())))
    units = records.formats[134].units
    assert units[1:] == ["mm", "mm", "deg/s", "km/h", "m/s/s", "m/s/s", "m/s/s"]


def test_the_logs_own_units_are_used(tmp_path):
    """A field's unit is the one that UNIT and FMTU give it, its number multiplied as MULT says."""
    path = ride(tmp_path, *(imu(k) for k in range(30)))
    lap = read(tmp_path, path, "IMU.GyrY")
    np.testing.assert_allclose(lap.channels["pitch_rate_dps"], np.degrees(0.01 * np.arange(30)), rtol=1e-6)
    assert lap.t_ns[0] == 10_000_000
    lap = read(tmp_path, path, "IMU.Err", "fork_stroke_mm")
    np.testing.assert_allclose(lap.channels["fork_stroke_mm"], 7.0 * np.arange(30))


def test_a_unit_in_the_map_takes_the_bare_number(tmp_path):
    """With a unit of its own the map means the number as it stands, without the log's multiplier."""
    path = ride(tmp_path, *(imu(k) for k in range(30)))
    lap = read(tmp_path, path, "IMU.Err", "fork_stroke_mm", 'unit = "cm"')
    np.testing.assert_allclose(lap.channels["fork_stroke_mm"], 70.0 * np.arange(30))


def test_fixed_point_numbers_are_scaled_once(tmp_path):
    """A letter for hundredths scales by itself; the multiplier that repeats it does not scale again."""
    path = ride(tmp_path, *(imu(k) for k in range(30)))
    lap = read(tmp_path, path, "IMU.Spd", "speed_kmh")
    np.testing.assert_allclose(lap.channels["speed_kmh"], 3.6 * (1.5 + 0.01 * np.arange(30)))


def test_the_instance_is_the_field_the_log_names(tmp_path):
    """Records of several sensors are told apart by the field marked as instance; unsaid, they are refused."""
    path = ride(tmp_path, *(imu(k, instance) for k in range(30) for instance in (0, 1)))
    lap = read(tmp_path, path, "IMU[1].GyrY")
    assert lap.channels["pitch_rate_dps"][0] == pytest.approx(np.degrees(1.0))
    with pytest.raises(LapError, match=r"the instance, I, of IMU in .* is 0, 1: say which"):
        read(tmp_path, path, "IMU.GyrY")


def test_several_types_share_the_clock(tmp_path):
    """Channels of different records come onto one grid, each by its own times."""
    other = Definition(160, "WHL", "Qf", ("TimeUS", "Front"))
    records = [imu(k) for k in range(100)] + [record(other, 7_000 + 20_000 * k, float(k)) for k in range(50)]
    path = ride(tmp_path, *records, extra=[other])
    (tmp_path / "map.toml").write_text(
        '[channels.pitch_rate_dps]\nsignal = "IMU.GyrY"\n'
        '[channels.speed_kmh]\nsignal = "WHL.Front"\nunit = "km/h"\n'
    )
    lap = read_lap(path, load_map(tmp_path / "map.toml"))
    assert set(np.diff(lap.t_ns)) == {10_000_000}
    np.testing.assert_allclose(lap.channels["speed_kmh"][:3], [0.15, 0.65, 1.15])


def test_arrays_and_old_clocks_are_read(tmp_path):
    """An element of an array is a signal; logs of before 2015 count in milliseconds."""
    waves = [record(ISBD, 1000 * k, k, np.arange(32) + k, b"hello") for k in range(20)]
    old = [record(OLD, 20 * k, k) for k in range(20)]
    path = ride(tmp_path, *waves, *old, extra=[ISBD, OLD])
    lap = read(tmp_path, path, "ISBD.x[31]", "fork_stroke_mm", 'unit = "mm"')
    assert lap.channels["fork_stroke_mm"].tolist() == [31.0 + k for k in range(20)]
    lap = read(tmp_path, path, "CTUN.ThrIn", "fork_stroke_mm", 'unit = "mm"')
    assert lap.t_ns[-1] == 380_000_000


def test_an_old_gps_has_the_clock_of_the_others(tmp_path):
    """Where the satellites' time of the week is logged as TimeMS, the clock is T."""
    gps = Definition(161, "GPS", "IHfI", ("TimeMS", "Week", "Spd", "T"))
    records = [record(gps, 600_000_000 + 200 * k, 1800, float(k), 5000 + 200 * k) for k in range(20)]
    lap = read(tmp_path, ride(tmp_path, *records, extra=[gps]), "GPS.Spd", "speed_kmh", 'unit = "m/s"')
    assert lap.t_ns[0] == 5_000_000_000


def test_types_without_fields_are_records(tmp_path):
    """A record of three bytes, as old logs have, is no damage."""
    start = Definition(10, "STRT", "", ())
    lap = read(
        tmp_path, ride(tmp_path, record(start), *(imu(k) for k in range(9)), extra=[start]), "IMU.GyrY"
    )
    assert lap.damage == ()


@pytest.mark.parametrize(
    ("signal", "says"),
    [
        ("GyrY", "signal 'GyrY' is not TYPE.field"),
        ("GYR.GyrY", r"GYR is not in .*00000042\.bin; that has FMT, IMU, UNIT, MULT, FMTU, ISBD"),
        ("CTUN.ThrIn", "CTUN is not in"),
        ("IMU.GyrW", "IMU has no GyrW; it has TimeUS, I, GyrX"),
        ("IMU[3].GyrY", "is 0: 3 is not there"),
        ("ISBD[0].N", "ISBD has no instances"),
        ("IMU.GyrY[0]", "is a single number"),
        ("ISBD.x", r"has elements \[0\] to \[31\]"),
        ("ISBD.x[32]", r"has elements \[0\] to \[31\]"),
        ("ISBD.Note", "is text"),
        ("FMT.Type", "FMT has no TimeUS or TimeMS"),
        ("ISBD.N", "no unit in the file or the map"),
        ("IMU.Err", "unit 'm'; pitch_rate_dps can come from"),
    ],
)
def test_a_map_that_does_not_fit_is_refused(tmp_path, signal, says):
    """What the map asks for and the log lacks is named in one line."""
    path = ride(tmp_path, imu(0), record(ISBD, 1, 2, np.zeros(32), b"x"), extra=[ISBD, OLD])
    with pytest.raises(LapError, match=says) as refusal:
        read(tmp_path, path, signal)
    assert "\n" not in str(refusal.value)


def test_a_log_of_others_needs_a_map(tmp_path):
    """Without a map only laps that were written here are read; the refusal lists the log's types."""
    with pytest.raises(LapError, match=r"no LAP with Fork, .*; a map may name FMT, IMU"):
        read_lap(ride(tmp_path, imu(0)))


@pytest.mark.parametrize("data", [bytes(9000), b"\xa3\x95\x80" * 3000, b"\xa3", b"t_s,speed_kmh\n0,1\n" * 50])
def test_what_is_no_dataflash_log_is_refused(tmp_path, data):
    """A file without a single record is refused."""
    with pytest.raises(LapError, match=f"no DataFlash record in its {len(data)} bytes"):
        read_lap(log(tmp_path, data))


def test_damaged_stretches_are_skipped_and_named(tmp_path, capfd):
    """After overwritten bytes the next whole record is found; the line has the bytes; nothing is printed."""
    records = [imu(k) for k in range(50)]
    path = ride(tmp_path, *records)
    data = bytearray(path.read_bytes())
    at, size = data.index(records[20]), len(records[20])
    data[at - 5 : at + 5] = b"\xff" * 10
    path.write_bytes(data)
    lap = read(tmp_path, path, "IMU.GyrY")
    assert len(lap.t_ns) == 48
    assert lap.damage[0] == (f"bytes {at - size} to {at + size - 1}: {2 * size} bytes are no whole message")
    assert lap.damage[1].startswith("gap of 30 ms")
    assert capfd.readouterr() == ("", "")


def test_a_record_with_bytes_missing_costs_no_other(tmp_path):
    """Where bytes are lost within a record the next one is not swallowed."""
    records = [imu(k) for k in range(50)]
    lap = read(tmp_path, ride(tmp_path, *records[:20], records[20][:9], *records[21:]), "IMU.GyrY")
    assert len(lap.t_ns) == 49


def test_a_cut_end_is_reported(tmp_path):
    """A log that ends within a record says so."""
    lap = read(tmp_path, ride(tmp_path, *(imu(k) for k in range(30)), imu(30)[:-1]), "IMU.GyrY")
    assert len(lap.t_ns) == 30
    assert lap.damage[0].endswith("bytes are no whole message, up to the end of the file")


def test_a_missing_end_of_a_written_lap_is_reported(tmp_path):
    """Cut between two records, a lap that was written here still says how many samples are missing."""
    path = tmp_path / "lap.bin"
    write_lap(a_lap(200), path)
    data = path.read_bytes()
    path.write_bytes(data[: -80 * (3 + 8 + 56)])
    assert read_lap(path).damage == ("120 samples are left of the 200 that were written",)


def test_a_damaged_label_is_reported(tmp_path):
    """A field of LAP that no lap has, as a damaged definition gives, is reported, not left out in silence."""
    path = tmp_path / "lap.bin"
    write_lap(a_lap(), path)
    path.write_bytes(path.read_bytes().replace(b"Rear", b"Pear"))
    back = read_lap(path)
    assert "rear_stroke_mm" not in back.channels
    assert back.damage == ("LAP has Pear, which is no channel's",)


def test_a_second_definition_does_not_replace_the_first(tmp_path):
    """A type that is defined twice, differently, keeps the first definition, and that is reported."""
    again = Definition(IMU.kind, "IMU", IMU.letters, (*IMU.labels[:-1], "Else"))
    lap = read(
        tmp_path,
        ride(tmp_path, definition_record(again), *(imu(k) for k in range(9))),
        "IMU.Spd",
        "speed_kmh",
    )
    assert "type 150 is defined again, as 'IMU'; the first holds" in lap.damage[0]


def test_a_definition_whose_labels_do_not_fit_is_reported(tmp_path):
    """A definition with a label too few is damage, and its records are passed over."""
    bad = bytearray(definition_record(OLD))
    bad[bad.index(b",ThrIn")] = ord("_")
    lap = read(
        tmp_path, ride(tmp_path, bytes(bad), record(OLD, 1, 2), *(imu(k) for k in range(9))), "IMU.GyrY"
    )
    assert "the definition of type 155, 'CTUN', is damaged; its records are skipped" in lap.damage[0]


def test_a_time_beyond_any_clock_is_dropped(tmp_path):
    """A microsecond count that nanoseconds cannot hold is dropped, not wrapped around."""
    wild = bytearray(imu(7))
    wild[3:11] = struct.pack("<Q", 2**63 + 5)
    records = [imu(k) for k in range(20)]
    lap = read(tmp_path, ride(tmp_path, *records[:7], bytes(wild), *records[8:]), "IMU.GyrY")
    assert len(lap.t_ns) == 19
    assert "1 of 20 samples are at a time no clock shows, dropped, the first is sample 7" in lap.damage[0]


def test_samples_within_a_microsecond_are_not_written(tmp_path):
    """Samples that would share a time in the log are refused."""
    lap = Lap(np.array([0, 1000, 1400]), {"speed_kmh": np.zeros(3)})
    with pytest.raises(LapError, match="samples 1 and 2 at 1000 and 1400 ns share a microsecond"):
        write_lap(lap, tmp_path / "lap.bin")


@pytest.mark.parametrize("seed", range(60))
def test_no_damage_beyond_a_value_passes_in_silence(tmp_path, seed, capfd):
    """Cut, flipped, or with bytes lost or doubled, a log is refused or reported.

    Unless a flipped bit lies in a number: values, units and the low bits of a time carry no checksum, so that
    the lap then has all its samples and at most one of them is another for each flip.
    """
    rng = np.random.default_rng(seed)
    lap = a_lap(60)
    path = tmp_path / "lap.bin"
    write_lap(lap, path)
    data, flips = bytearray(path.read_bytes()), 0
    if seed % 3 == 0:
        del data[rng.integers(1, len(data)) :]
    elif seed % 3 == 1:
        flips = 1 + seed % 4
        for at in rng.integers(0, len(data), flips):
            data[at] ^= 1 << rng.integers(8)
    else:
        at, size = int(rng.integers(len(data))), int(rng.integers(1, 300))
        data[at : at + size] = b"" if seed % 2 else data[at : at + size] * 2
    path.write_bytes(data)
    try:
        back = read_lap(path)
    except LapError:
        back = None
    if back is not None and not back.damage:
        changed = back.t_ns != lap.t_ns
        for name in CHANNELS:
            changed |= back.channels[name] != lap.channels[name]
        assert np.count_nonzero(changed) <= flips
    assert capfd.readouterr() == ("", "")
