"""From logs to channels: what is true of every CAN log whatever its format, and what a DBC may lack."""

import can
import numpy as np
import pytest

from bench.codec import Codec
from bench.errors import BusError, LapError
from bench.laps.channel_map import load_map
from bench.laps.files import format_of
from bench.laps.recording import Recording
from bench.sensors.transducers import BY_CHANNEL
from tests.bench.laps.can.logs import DBC, EVERY, FRAMES, REAR_RAW, STROKE_RAW, candump, strokes, write
from tests.conftest import SHARED

TOYOTA = SHARED / "data" / "comma2k19-toyota-can"
SIGNAL = ' SG_ Fork : 7|16@0- (0.01,2) [0|0] "cm" NODE\n'
MOTOROLA = f"{DBC}BO_ 291 SUSPENSION: 4 NODE\n{SIGNAL}"
MULTIPLEXED = MOTOROLA.replace("Fork :", "Fork m0 :") + ' SG_ Kind M : 23|8@0+ (1,0) [0|0] "" NODE\n'
every_format = pytest.mark.parametrize("suffix", EVERY)


def read(path, channel_map=None) -> Recording:
    return format_of(path).read(path, channel_map)


def mapped(tmp_path, text, dbc=None):
    """A channel map of `text`, with a DBC beside it if there is one."""
    if dbc is not None:
        (tmp_path / "bike.dbc").write_text(dbc)
        text = 'dbc = "bike.dbc"\n' + text
    (tmp_path / "map.toml").write_text(text)
    return load_map(tmp_path / "map.toml")


@every_format
@pytest.mark.parametrize("packed", ["", ".gz"], ids=["plain", "gz"])
def test_every_format_gives_the_same_strokes(tmp_path, suffix, packed):
    """What python-can writes is decoded exactly, each frame at its 10 ms, packed or not."""
    recording = read(write(tmp_path / f"ride{suffix}{packed}", strokes()))
    assert (recording.source, recording.damage) == (f"ride{suffix}{packed}", ())
    assert list(recording.tracks) == ["fork_stroke_mm", "rear_stroke_mm"]
    for name, raw in (("fork_stroke_mm", STROKE_RAW), ("rear_stroke_mm", REAR_RAW)):
        track = recording.tracks[name]
        assert track.values.tolist() == (raw * BY_CHANNEL[name].per_code).tolist()
        # python-can's .mf4 counts from the second at which it was made
        assert np.abs(track.t_ns - track.t_ns[0] - np.arange(FRAMES) * 10_000_000).max() <= 1000 * (
            suffix == ".mf4"
        )


@every_format
def test_epochs_keep_their_steps(tmp_path, suffix):
    """A log that counts from 1970 keeps the 10 ms between its frames to the microsecond."""
    messages = strokes()
    for message in messages:
        message.timestamp += 1_700_000_000
    t_ns = read(write(tmp_path / f"ride{suffix}", messages)).tracks["fork_stroke_mm"].t_ns
    assert np.abs(np.diff(t_ns) - 10_000_000).max() <= 1000


@every_format
def test_what_is_no_data_of_ours_is_passed_over(tmp_path, suffix):
    """Remote frames, error frames and identifiers of no message leave the channels as they are."""
    others = [
        can.Message(timestamp=0.101, arbitration_id=0x100, is_extended_id=True, data=bytes(8), channel=0),
        can.Message(timestamp=0.102, arbitration_id=0x6FF, is_extended_id=False, data=bytes(8), channel=0),
        can.Message(
            timestamp=0.103,
            arbitration_id=0x100,
            is_extended_id=False,
            is_remote_frame=True,
            dlc=4,
            channel=0,
        ),
        can.Message(timestamp=0.104, is_error_frame=True, channel=0),
    ]
    messages = sorted([*strokes(), *others], key=lambda message: message.timestamp)
    recording = read(write(tmp_path / f"ride{suffix}", messages))
    assert recording.damage == ()
    assert len(recording.tracks["fork_stroke_mm"].t_ns) == FRAMES


def test_a_map_takes_a_signal_from_another_dbc(tmp_path):
    """A Motorola signal of the map's DBC becomes the channel, its unit from the DBC, scaled and shifted."""
    channel_map = mapped(
        tmp_path,
        'rate_hz = 500\n[channels.fork_stroke_mm]\nsignal = "SUSPENSION.Fork"\nscale = 2\noffset = 1\n',
        MOTOROLA,
    )
    log = candump(tmp_path / "a.log", "(1.0) can0 123#0064FFFF", "(2.0) can0 123#FF9CFFFF")
    recording = read(log, channel_map)
    # 100 and -100, times 0.01 plus 2, centimetres
    assert recording.tracks["fork_stroke_mm"].values.tolist() == [3.0 * 20 + 1, 1.0 * 20 + 1]
    assert (recording.rate_hz, recording.common) == (500.0, False)


def test_a_map_picks_the_bus(tmp_path):
    """Of frames on several buses those of the map's bus are taken; without one all, and it is said."""
    row = '[channels.fork_stroke_mm]\nsignal = "STROKES.fork_stroke_mm"\n'
    log = candump(tmp_path / "a.log", 10, 20, "(0.030000) can1 100#FFFFFFFF", "(0.040000) vcan1 100#FFFFFFFF")
    both = read(log, mapped(tmp_path, row))
    assert len(both.tracks["fork_stroke_mm"].t_ns) == 4
    assert both.damage == (
        "STROKES (0x100) is on buses 0, 1, all of them read; `bus` in a channel map picks one",
    )
    one = read(log, mapped(tmp_path, row + "bus = 1\n"))
    assert one.tracks["fork_stroke_mm"].t_ns.tolist() == [30_000_000, 40_000_000]
    assert one.damage == ()
    with pytest.raises(LapError, match=r"no frame of STROKES \(0x100\) on bus 7: it is on bus 0, 1"):
        read(log, mapped(tmp_path, row + "bus = 7\n"))


@pytest.mark.parametrize("suffix", [".asc", ".blf", ".trc", pytest.param(".mf4", marks=EVERY[-1].marks)])
def test_buses_are_numbered_as_the_file_shows_them(tmp_path, suffix):
    """Channel 1 of the file is bus 1 of the map."""
    channel = 1 if suffix == ".mf4" else 0  # python-can's writers count from 0, but for this one
    log = write(tmp_path / f"ride{suffix}", strokes(channel))
    row = '[channels.fork_stroke_mm]\nsignal = "STROKES.fork_stroke_mm"\nbus = 1\n'
    assert len(read(log, mapped(tmp_path, row)).tracks["fork_stroke_mm"].t_ns) == FRAMES


@pytest.mark.parametrize("suffix", [".csv", ".db"])
def test_a_bus_of_a_log_that_names_none_is_refused(tmp_path, suffix):
    """A map that asks for a bus of a log without buses is told so."""
    log = write(tmp_path / f"ride{suffix}", strokes())
    row = '[channels.fork_stroke_mm]\nsignal = "STROKES.fork_stroke_mm"\nbus = 0\n'
    with pytest.raises(LapError, match="on bus 0: the log names no bus"):
        read(log, mapped(tmp_path, row))


def test_frames_that_are_too_short_are_damage(tmp_path):
    """Frames shorter than their message are left out, counted, and the first is named with its line."""
    log = candump(tmp_path / "a.log", 10, "(0.020000) can0 100#0102", 30, "(0.040000) can0 100#")
    recording = read(log)
    assert recording.tracks["fork_stroke_mm"].t_ns.tolist() == [10_000_000, 30_000_000]
    assert recording.damage == (
        "STROKES (0x100): 2 frames shorter than its 4 bytes passed over, the first at line 2 with 2",
    )


def test_can_fd_frames_are_named(tmp_path):
    """CAN FD frames with a mapped identifier are left out and counted; a log of nothing else is refused."""
    log = candump(tmp_path / "a.log", 10, "(0.020000) can0 100##1FFFFFFFF", 30)
    assert read(log).damage == ("STROKES (0x100): 1 CAN FD frames passed over",)
    only = candump(tmp_path / "b.log", "(0.020000) can0 100##1FFFFFFFF")
    row = '[channels.fork_stroke_mm]\nsignal = "STROKES.fork_stroke_mm"\n'
    with pytest.raises(LapError, match=r"b\.log: no frame of STROKES \(0x100\): STROKES \(0x100\): 1 CAN FD"):
        read(only, mapped(tmp_path, row))


def test_a_log_of_somebody_elses_bus_is_refused(tmp_path):
    """Where no frame is ours the message says what was looked for and what is there."""
    log = candump(tmp_path / "a.log", "(1.0) can0 12F#00", "(1.1) can0 290#00", "(1.2) can0 290#00")
    with pytest.raises(
        LapError, match=r"no frame of STROKES \(0x100\), .*; its 3 frames bear 0x290, 0x12f; a channel"
    ):
        read(log)


@pytest.mark.parametrize(
    ("dbc", "signal", "error", "says"),
    [
        (MOTOROLA, "Fork", LapError, "signal 'Fork' is not MESSAGE.SIGNAL"),
        (
            MOTOROLA,
            "FRAME.Fork",
            LapError,
            r"bike\.dbc: no message FRAME for fork_.*; its messages are SUSPENSION",
        ),
        (
            MOTOROLA,
            "SUSPENSION.Rear",
            LapError,
            r"bike\.dbc: message SUSPENSION has no signal Rear; .* are Fork",
        ),
        (
            MOTOROLA.replace('"cm"', '"V"'),
            "SUSPENSION.Fork",
            LapError,
            "unit 'V'; fork_stroke_mm can come from mm,",
        ),
        (MOTOROLA.replace('"cm"', '""'), "SUSPENSION.Fork", LapError, "no unit in the file or the map"),
        (MOTOROLA + "BO_ 291 OTHER: 4 NODE\n", "SUSPENSION.Fork", BusError, "0x123: SUSPENSION and OTHER"),
        (
            MOTOROLA + "BO_ 292 SUSPENSION: 4 NODE\n",
            "SUSPENSION.Fork",
            BusError,
            "SUSPENSION is defined twice",
        ),
        (MULTIPLEXED, "SUSPENSION.Fork", BusError, "SUSPENSION is multiplexed"),
        (
            MOTOROLA.replace(": 4 NODE", ": 16 NODE"),
            "SUSPENSION.Fork",
            BusError,
            "16 bytes, more than a classic",
        ),
        (MOTOROLA + SIGNAL, "SUSPENSION.Fork", BusError, "SUSPENSION defines the signal Fork twice"),
        (MOTOROLA.replace("0.01", "1e999"), "SUSPENSION.Fork", LapError, "Fork: scale inf gives no number"),
        ("nonsense", "SUSPENSION.Fork", BusError, r"bike\.dbc: not a DBC file"),
    ],
)
def test_a_dbc_that_does_not_fit_is_refused(tmp_path, dbc, signal, error, says):
    """What the DBC lacks, doubles or the codec cannot read is named in one line."""
    channel_map = mapped(tmp_path, f'[channels.fork_stroke_mm]\nsignal = "{signal}"\n', dbc)
    with pytest.raises(error, match=says) as refusal:
        read(candump(tmp_path / "a.log", "(1.0) can0 123#0064FFFF"), channel_map)
    assert "\n" not in str(refusal.value)


def test_a_missing_dbc_is_refused(tmp_path):
    """A DBC that is not there is named."""
    channel_map = mapped(tmp_path, 'dbc = "none.dbc"\n[channels.fork_stroke_mm]\nsignal = "A.b"\n')
    with pytest.raises(BusError, match=r"none\.dbc: No such file"):
        read(candump(tmp_path / "a.log", 10), channel_map)


def test_identifiers_of_eleven_and_of_29_bits_are_different(tmp_path):
    """Two messages of one number, one of them extended, are no collision."""
    dbc = MOTOROLA + f"BO_ {0x80000000 | 291} OTHER: 4 NODE\n"
    channel_map = mapped(tmp_path, '[channels.fork_stroke_mm]\nsignal = "SUSPENSION.Fork"\n', dbc)
    log = candump(tmp_path / "a.log", "(1.0) can0 123#0064FFFF", "(1.5) can0 00000123#FFFFFFFF")
    assert read(log, channel_map).tracks["fork_stroke_mm"].t_ns.tolist() == [1_000_000_000]


@pytest.mark.skipif(not TOYOTA.is_dir(), reason="shared/data/comma2k19-toyota-can is not there")
@pytest.mark.parametrize("wheel", ["FL", "FR", "RL", "RR"])
def test_a_toyotas_wheel_speeds_are_exact(tmp_path, wheel):
    """Decoded through its DBC, a minute of raw CAN gives the supplied wheel speeds.

    Exactly: km/h times the float64 of 1/3.6, as openpilot converts, is the supplied float64 in m/s.
    """
    raw = {
        name: np.load(TOYOTA / "processed_log/CAN/raw_can" / name) for name in ("t", "address", "data", "src")
    }
    lines = [
        f"({t:.6f}) can{bus} {address:03X}#{data.ljust(8, bytes(1)).hex()}\n"
        for t, address, data, bus in zip(
            *(raw[name].tolist() for name in ("t", "address", "data", "src")), strict=True
        )
        if address <= 0x7FF
    ]
    (tmp_path / "toyota.log").write_text("".join(lines))
    (tmp_path / "bike.dbc").write_bytes((TOYOTA / "dbc" / "_toyota_2017.dbc").read_bytes())
    text = f'dbc = "bike.dbc"\n[channels.speed_kmh]\nsignal = "WHEEL_SPEEDS.WHEEL_SPEED_{wheel}"\nbus = 0\n'
    track = read(tmp_path / "toyota.log", mapped(tmp_path, text)).tracks["speed_kmh"]
    supplied = np.load(TOYOTA / "processed_log/CAN/wheel_speed/value")[
        :, ["FL", "FR", "RL", "RR"].index(wheel)
    ]
    instants = np.load(TOYOTA / "processed_log/CAN/wheel_speed/t")
    assert (track.values * (1 / 3.6)).tolist() == supplied.tolist()
    assert np.abs(track.t_ns - instants * 1e9).max() < 1000


def test_the_dbc_is_parsed_once(tmp_path, monkeypatch):
    """Two logs read through the same DBC cost one parse."""
    Codec()
    import cantools

    monkeypatch.setattr(cantools.database, "load_string", None)
    for name in "ab":
        read(candump(tmp_path / f"{name}.log", 10, 20))
