"""MAVLink telemetry logs, against pymavlink as an independent writer and reader."""

import os
import re
import struct
import sys

import numpy as np
import pytest

from bench.errors import LapError
from bench.laps import CHANNELS, Lap, read_lap, write_lap
from bench.laps.channel_map import load_map
from bench.laps.mavlink.framing import dialect

mavlink = pytest.importorskip("pymavlink.dialects.v20.ardupilotmega", reason="pymavlink is not installed")

START_US = 1_700_000_000_000_000


def a_lap(samples=200, names=CHANNELS):
    rng = np.random.default_rng(4)
    values = {name: rng.standard_normal(samples).astype(np.float32).astype(float) for name in names}
    return Lap(np.arange(samples) * 1_000_000 + 5_000, values)


def sender(system=1, component=1):
    return mavlink.MAVLink(None, srcSystem=system, srcComponent=component)


def attitude(k):
    return mavlink.MAVLink_attitude_message(1000 + 10 * k, 0.1, 0.2, 0.3, 0.0, 0.01 * k, 0.0)


def named(k, name=b"fork", value=None):
    return mavlink.MAVLink_named_value_float_message(
        1000 + 10 * k, name, float(2 * k if value is None else value)
    )


def record(message, t_us, mav=None, **options):
    return struct.pack(">Q", t_us) + message.pack(mav or sender(), **options)


def log(tmp_path, *records):
    path = tmp_path / "ride.tlog"
    path.write_bytes(b"".join(records))
    return path


def attitudes(count=50, mav=None):
    mav = mav or sender()
    return [record(attitude(k), START_US + 10_000 * k, mav) for k in range(count)]


def a_map(tmp_path, **signals):
    """A channel map; each channel's value is its signal, or the lines of its table."""
    path = tmp_path / "map.toml"
    text = ""
    for name, row in signals.items():
        text += f"[channels.{name}]\n" + (row if "=" in row else f'signal = "{row}"') + "\n"
    path.write_text(text)
    return load_map(path)


def pitch(tmp_path, path, signal="ATTITUDE.pitchspeed"):
    return read_lap(path, a_map(tmp_path, pitch_rate_dps=signal))


def test_a_lap_comes_back_within_float32(tmp_path):
    """Values come back as float32, times to the microsecond, gaps and missing channels as they were."""
    rng = np.random.default_rng(0)
    t_ns = np.cumsum(rng.integers(1_000, 3_000_000, 300))
    lap = Lap(t_ns, {"fork_stroke_mm": rng.uniform(0, 150, 300), "acc_body_ms2": np.zeros(300)})
    write_lap(lap, tmp_path / "lap.tlog")
    back = read_lap(tmp_path / "lap.tlog")
    assert list(back.channels) == ["fork_stroke_mm", "acc_body_ms2"]
    assert np.abs(back.t_ns - lap.t_ns).max() <= 500
    for name, values in lap.channels.items():
        np.testing.assert_array_equal(back.channels[name], values.astype(np.float32))


def test_pymavlink_reads_what_is_written(tmp_path):
    """An independent reader finds every packet of a written log sound, with time, name and values."""
    lap = a_lap(300)
    write_lap(lap, tmp_path / "lap.tlog")
    data = (tmp_path / "lap.tlog").read_bytes()
    reader, at, floats = mavlink.MAVLink(None), 0, []
    while at < len(data):
        size = 8 + 12 + data[at + 9]
        message = reader.decode(bytearray(data[at + 8 : at + size]))
        if message.get_type() == "DEBUG_FLOAT_ARRAY":
            assert struct.unpack(">Q", data[at : at + 8])[0] == message.time_usec
            assert message.name == "strokes"
            floats.append((message.time_usec, *message.data[:7]))
        at += size
    expected = np.column_stack((lap.t_ns / 1000, *lap.channels.values()))
    np.testing.assert_array_equal(floats, expected)


@pytest.mark.parametrize("options", [{}, {"force_mavlink1": True}])
def test_reads_what_pymavlink_packs(tmp_path, options):
    """Packets of both versions give the field, in the dialect's unit, at the message's own time."""
    lap = pitch(tmp_path, log(tmp_path, *(record(attitude(k), START_US, **options) for k in range(50))))
    assert lap.damage == ()
    assert lap.t_ns.tolist() == [1_000_000_000 + 10_000_000 * k for k in range(50)]
    np.testing.assert_allclose(lap.channels["pitch_rate_dps"], np.degrees(0.01 * np.arange(50)), rtol=1e-6)


def test_signed_packets_are_read(tmp_path):
    """A signature behind a packet is stepped over."""
    mav = sender()
    mav.signing.secret_key, mav.signing.sign_outgoing, mav.signing.timestamp = b"k" * 32, True, 1
    lap = pitch(tmp_path, log(tmp_path, *attitudes(20, mav)))
    assert len(lap.t_ns) == 20
    assert lap.damage == ()


def test_zeros_that_were_not_sent_are_read(tmp_path):
    """Version 2 leaves out zeros at a payload's end; the fields there are zero."""
    records = [
        record(mavlink.MAVLink_attitude_message(k, 1, 0, 0, 0, 0, 0), START_US + 1000 * k) for k in range(9)
    ]
    assert pitch(tmp_path, log(tmp_path, *records)).channels["pitch_rate_dps"].tolist() == [0.0] * 9


def test_a_name_or_a_number_picks_the_instance(tmp_path):
    """Of messages that share a type, the one in brackets is read: by name, or by instance number."""
    records = []
    for k in range(20):
        records += [record(named(k), START_US + k), record(named(k, b"rear", 7), START_US + k)]
        for sensor in (0, 1):
            imu = mavlink.MAVLink_raw_imu_message(
                1_000_000 + 10_000 * k, 0, 0, 0, 100 * sensor + k, 0, 0, 0, 0, 0, id=sensor
            )
            records.append(record(imu, START_US + k))
    lap = read_lap(
        log(tmp_path, *records),
        a_map(
            tmp_path,
            fork_stroke_mm='signal = "NAMED_VALUE_FLOAT[fork].value"\nunit = "mm"',
            rear_stroke_mm='signal = "NAMED_VALUE_FLOAT[rear].value"\nunit = "cm"\noffset = 1',
            pitch_rate_dps='signal = "RAW_IMU[1].xgyro"\nunit = "mrad/s"',
        ),
    )
    np.testing.assert_allclose(lap.channels["fork_stroke_mm"], 2.0 * np.arange(20))
    np.testing.assert_allclose(lap.channels["rear_stroke_mm"], 71.0)
    np.testing.assert_allclose(lap.channels["pitch_rate_dps"], np.degrees(0.1 + 0.001 * np.arange(20)))


def test_the_stamps_serve_where_a_message_has_no_clock(tmp_path):
    """With one mapped message that has no time of its own, all channels use the log's stamps."""
    records = []
    for k in range(100):
        records.append(record(attitude(k), START_US + 10_000 * k))
        records.append(record(mavlink.MAVLink_vfr_hud_message(0, k, 0, 0, 0, 0), START_US + 10_000 * k))
    lap = read_lap(
        log(tmp_path, *records),
        a_map(tmp_path, pitch_rate_dps="ATTITUDE.pitchspeed", speed_kmh="VFR_HUD.groundspeed"),
    )
    np.testing.assert_allclose(lap.channels["speed_kmh"], 3.6 * np.arange(100))
    np.testing.assert_allclose(lap.channels["pitch_rate_dps"], np.degrees(0.01 * np.arange(100)), rtol=1e-5)


def test_the_maps_rate_makes_the_grid(tmp_path):
    """With `rate_hz` even a single message type is brought to that rate."""
    path = tmp_path / "map.toml"
    path.write_text('rate_hz = 500\n[channels.pitch_rate_dps]\nsignal = "ATTITUDE.pitchspeed"\n')
    lap = read_lap(log(tmp_path, *attitudes(50)), load_map(path))
    assert set(np.diff(lap.t_ns)) == {2_000_000}


def test_several_senders_are_told_apart(tmp_path):
    """A type that two systems send is refused unless `bus` says which is meant."""
    records = []
    for k in range(20):
        records += [record(attitude(k), START_US + k, sender(1, 1))]
        records += [record(attitude(2 * k), START_US + k, sender(2, 9))]
    path = log(tmp_path, *records)
    with pytest.raises(LapError, match=r"`bus`, 256 x system \+ component, .* is 257, 521: say which"):
        pitch(tmp_path, path)
    for bus in (2, 521):
        lap = pitch(tmp_path, path, f'signal = "ATTITUDE.pitchspeed"\nbus = {bus}')
        assert lap.t_ns[1] - lap.t_ns[0] == 20_000_000
    with pytest.raises(LapError, match=r"the system of ATTITUDE in .* is 1, 2: 3 is not there"):
        pitch(tmp_path, path, 'signal = "ATTITUDE.pitchspeed"\nbus = 3')


def test_damaged_packets_are_reported_with_their_place(tmp_path, capfd):
    """A packet with a wrong checksum is skipped, the next one found, the bytes named; nothing is printed."""
    records = attitudes(50)
    damaged = bytearray(records[20])
    damaged[25] ^= 0x10
    start, size = sum(map(len, records[:20])), len(damaged)
    lap = pitch(tmp_path, log(tmp_path, *records[:20], bytes(damaged), *records[21:]))
    assert len(lap.t_ns) == 49
    assert lap.damage[0] == f"bytes {start} to {start + size - 1}: {size} bytes are no whole message"
    assert lap.damage[1].startswith("gap of 20 ms")
    assert capfd.readouterr() == ("", "")


def test_many_damaged_stretches_are_counted(tmp_path):
    """The first five stretches are named, the rest counted."""
    lap = pitch(tmp_path, log(tmp_path, *(b"garbage" + one for one in attitudes(20))))
    assert len(lap.t_ns) == 20
    assert len(lap.damage) == 6
    assert lap.damage[-1].startswith("and 15 more such stretches, 105 bytes, the last at byte ")


def test_a_cut_end_is_reported(tmp_path):
    """A log that ends within a packet says so."""
    records = attitudes(30)
    lap = pitch(tmp_path, log(tmp_path, *records[:-1], records[-1][:-3]))
    assert len(lap.t_ns) == 29
    assert lap.damage[0].endswith("bytes are no whole message, up to the end of the file")


def test_a_missing_end_of_a_written_lap_is_reported(tmp_path):
    """Cut between two packets, a lap that was written here still says how many samples are missing."""
    path = tmp_path / "lap.tlog"
    write_lap(a_lap(200), path)
    data = path.read_bytes()
    sizes, at = [], 0
    while at < len(data):
        at += 20 + data[at + 9]
        sizes.append(at)
    path.write_bytes(data[: sizes[120]])
    assert read_lap(path).damage == ("120 samples are left of the 200 that were written",)


def test_unknown_messages_are_reported(tmp_path):
    """A packet of a type that the dialect lacks is passed over by its length and counted."""
    strange = bytes.fromhex("fd04000000010139a901") + b"abcd" + b"\x12\x34"
    records = attitudes(30)
    lap = pitch(tmp_path, log(tmp_path, *records[:10], struct.pack(">Q", START_US) + strange, *records[10:]))
    at = sum(map(len, records[:10]))
    assert lap.damage == (
        "messages of types that the dialect lacks are passed over: 1, the first, type "
        f"{0x01A939}, at byte {at}",
    )


def test_values_that_are_no_numbers_are_dropped(tmp_path):
    """NaN, MAVLink's way of not knowing, is dropped and counted."""
    records = [record(named(k, value=np.nan if k in (5, 6) else k), START_US) for k in range(20)]
    lap = read_lap(
        log(tmp_path, *records),
        a_map(tmp_path, fork_stroke_mm='signal = "NAMED_VALUE_FLOAT.value"\nunit = "mm"'),
    )
    assert len(lap.t_ns) == 18
    assert lap.damage[0] == (
        "NAMED_VALUE_FLOAT.value: 2 of 20 samples are no number, dropped, the first is sample 5"
    )


def test_a_time_beyond_any_clock_is_dropped(tmp_path):
    """A microsecond count that nanoseconds cannot hold is dropped, not wrapped around."""
    records = [
        record(
            mavlink.MAVLink_debug_vect_message(b"v", (k + 1) * 1000 if k != 7 else 2**63, k, 0, 0), START_US
        )
        for k in range(20)
    ]
    lap = read_lap(
        log(tmp_path, *records), a_map(tmp_path, fork_stroke_mm='signal = "DEBUG_VECT.x"\nunit = "mm"')
    )
    assert len(lap.t_ns) == 19
    assert "1 of 20 samples are at a time no clock shows, dropped" in lap.damage[0]


@pytest.mark.parametrize(
    ("signal", "says"),
    [
        ("pitchspeed", "signal 'pitchspeed' is not TYPE.field"),
        ("ATTITUDE", "signal 'ATTITUDE' is not TYPE.field"),
        ("ATITUDE.pitchspeed", "ATITUDE is no message of MAVLink's ardupilotmega dialect"),
        ("VFR_HUD.groundspeed", r"VFR_HUD is not in .*ride\.tlog; that has .*ATTITUDE"),
        ("ATTITUDE.speed", "ATTITUDE has no speed; it has time_boot_ms, roll"),
        ("ATTITUDE[2].pitchspeed", "ATTITUDE has no instances"),
        ("ATTITUDE.pitchspeed[1]", "is a single number"),
        ("ATTITUDE.pitch", "unit 'rad'; pitch_rate_dps can come from"),
        ("NAMED_VALUE_FLOAT.value", "the name of NAMED_VALUE_FLOAT in .* is fork, rear: say which"),
        ("NAMED_VALUE_FLOAT[tail].value", "is fork, rear: tail is not there"),
        ("NAMED_VALUE_FLOAT[fork].value", "no unit in the file or the map"),
        ("NAMED_VALUE_FLOAT[fork].name", "is text"),
        ("DEBUG_FLOAT_ARRAY.data", r"has elements \[0\] to \[57\]"),
        ("DEBUG_FLOAT_ARRAY.data[58]", r"has elements \[0\] to \[57\]"),
    ],
)
def test_a_map_that_does_not_fit_is_refused(tmp_path, signal, says):
    """What the map asks for and the log or the dialect lacks is named in one line."""
    array = mavlink.MAVLink_debug_float_array_message(1, b"x", 0)
    path = log(tmp_path, *attitudes(5), record(named(1), 1), record(named(1, b"rear"), 1), record(array, 1))
    with pytest.raises(LapError, match=says) as refusal:
        pitch(tmp_path, path, signal)
    assert "map.toml" in str(refusal.value) or "ride.tlog" in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_a_log_of_others_needs_a_map(tmp_path):
    """Without a map only laps that were written here are read; the refusal says what a map is for."""
    with pytest.raises(
        LapError, match=r"DEBUG_FLOAT_ARRAY is not in .* ATTITUDE; a channel map says what is what"
    ):
        read_lap(log(tmp_path, *attitudes()))


@pytest.mark.parametrize("data", [b"\xfd" * 5000, b"\xfe\x00" * 3000, b"t_s,speed_kmh\n0,1\n" * 50, b"\xfd"])
def test_what_is_no_mavlink_is_refused(tmp_path, data):
    """A file without a single sound packet is refused."""
    with pytest.raises(LapError, match=f"no MAVLink message in its {len(data)} bytes"):
        read_lap(log(tmp_path, data))


def test_without_pymavlink_the_refusal_says_how_to_get_it(tmp_path, monkeypatch):
    """Where pymavlink is missing, one line has the command that installs it."""
    write_lap(a_lap(), tmp_path / "lap.tlog")
    monkeypatch.setitem(sys.modules, "pymavlink.dialects.v20", None)
    dialect.cache_clear()
    with pytest.raises(LapError, match=re.escape("pip install 'strokebench[mavlink]'")):
        read_lap(tmp_path / "lap.tlog")


def test_values_beyond_float32_are_not_written(tmp_path):
    """A value that float32 cannot hold is refused, naming channel and sample."""
    lap = Lap(np.arange(3) * 1000, {"speed_kmh": np.array([1.0, 2.0, 1e39])})
    with pytest.raises(LapError, match=r"speed_kmh is 1e\+39 at sample 2: more than float32 holds"):
        write_lap(lap, tmp_path / "lap.tlog")


def test_samples_within_a_microsecond_are_not_written(tmp_path):
    """Samples that would share a time in the log are refused."""
    lap = Lap(np.array([0, 1000, 1400]), {"speed_kmh": np.zeros(3)})
    with pytest.raises(LapError, match="samples 1 and 2 at 1000 and 1400 ns share a microsecond"):
        write_lap(lap, tmp_path / "lap.tlog")


@pytest.mark.parametrize("suffix", [".tlog", ".bin", ".sst"])
def test_a_file_of_gigabytes_is_refused_unread(tmp_path, suffix):
    """A file of more bytes than any log has is refused by its size."""
    path = tmp_path / f"lap{suffix}"
    path.touch()
    os.truncate(path, 3 << 30)
    with pytest.raises(LapError, match="3221225472 bytes; a log is read up to"):
        read_lap(path)


@pytest.mark.parametrize("suffix", [".tlog", ".bin"])
def test_a_date_is_not_written(tmp_path, suffix):
    """A lap whose time would be read back as a date, and set to 0, is refused."""
    lap = Lap(np.array([0, 10**18 + 1]), {"speed_kmh": np.zeros(2)})
    with pytest.raises(LapError, match="time 1000000000000000001 ns does not fit"):
        write_lap(lap, tmp_path / f"lap{suffix}")


@pytest.mark.parametrize("seed", range(60))
def test_no_damage_passes_in_silence(tmp_path, seed, capfd):
    """Cut, flipped, or with bytes lost or doubled, a log is refused, reported, or gives the very same lap."""
    rng = np.random.default_rng(seed)
    lap = a_lap(60)
    path = tmp_path / "lap.tlog"
    write_lap(lap, path)
    data = bytearray(path.read_bytes())
    if seed % 3 == 0:
        del data[rng.integers(1, len(data)) :]
    elif seed % 3 == 1:
        for at in rng.integers(0, len(data), 1 + seed % 4):
            data[at] ^= 1 << rng.integers(8)
    else:
        at, size = int(rng.integers(len(data))), int(rng.integers(1, 300))
        data[at : at + size] = b"" if seed % 2 else data[at : at + size] * 2
    path.write_bytes(data)
    try:
        back = read_lap(path)
        assert back.damage or back == lap
    except LapError:
        pass
    assert capfd.readouterr() == ("", "")
