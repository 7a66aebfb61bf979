"""The codec, against cantools as oracle where both have the same rule."""

from pathlib import Path

import cantools
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from bench.codec import Codec
from bench.errors import BusError
from dbc import MOTORCYCLE

CODEC = Codec()
ORACLE = cantools.database.load_file(MOTORCYCLE)
EACH = pytest.mark.parametrize("name", [message.name for message in ORACLE.messages])

HEAD = 'VERSION ""\nNS_ :\nBS_:\nBU_: NODE\n'


@pytest.fixture
def dbc(tmp_path):
    def write(body):
        path = tmp_path / "layout.dbc"
        path.write_text(HEAD + body, encoding="ascii")
        return path

    return write


def raws(message):
    return st.fixed_dictionaries(
        {s.name: st.integers(s.raw_min, s.raw_max) for s in message.signals.values()}
    )


@EACH
@given(data=st.data())
def test_packs_as_cantools(name, data):
    """Raw values of the motorcycle's messages pack into the bytes that cantools packs."""
    frames = data.draw(st.lists(raws(CODEC.message(name)), min_size=1, max_size=5))
    packed = CODEC.pack(name, {key: np.array([frame[key] for frame in frames]) for key in frames[0]})
    expected = [ORACLE.encode_message(name, frame, scaling=False, strict=False) for frame in frames]
    assert [row.tobytes() for row in packed] == expected


@EACH
@given(data=st.data())
def test_decodes_as_cantools(name, data):
    """Any payload decodes to cantools' physical values, one at a time and many at once."""
    length = CODEC.message(name).length
    payloads = data.draw(st.lists(st.binary(min_size=length, max_size=length), min_size=1, max_size=5))
    expected = [ORACLE.decode_message(name, payload, decode_choices=False) for payload in payloads]
    assert [CODEC.decode(name, payload) for payload in payloads] == expected
    columns = CODEC.decode_all(name, np.frombuffer(b"".join(payloads), np.uint8).reshape(-1, length))
    assert [{key: column[k] for key, column in columns.items()} for k in range(len(payloads))] == expected


@st.composite
def layouts(draw):
    """A DBC body with one message of both byte orders, no two signals on one bit; its signal names."""
    length = draw(st.integers(1, 8))
    taken, lines = set(), []
    for k in range(draw(st.integers(1, 6))):
        bits = draw(st.integers(1, min(52, 8 * length)))
        start, order = draw(st.integers(0, 8 * length - 1)), draw(st.integers(0, 1))
        # in the order of transmission a Motorola signal runs from its start bit down, then into the next byte
        line = start if order else (start // 8) * 8 + 7 - start % 8
        if line + bits > 8 * length:
            continue
        mine = {b if order else (b // 8) * 8 + 7 - b % 8 for b in range(line, line + bits)}
        if mine & taken:
            continue
        taken |= mine
        sign = draw(st.sampled_from("+-"))
        lines.append(f' SG_ s{k} : {start}|{bits}@{order}{sign} (0.5,3) [0|0] "" NODE')
    assume(lines)
    return f"BO_ 291 M: {length} NODE\n" + "\n".join(lines) + "\n"


@settings(max_examples=60)
@given(layouts(), st.data())
def test_any_layout_as_cantools(tmp_path_factory, body, data):
    """Intel and Motorola, signed and unsigned signals in any free place pack and unpack as cantools does."""
    path = tmp_path_factory.mktemp("layout") / "any.dbc"
    path.write_text(HEAD + body, encoding="ascii")
    codec, oracle = Codec(path), cantools.database.load_string(HEAD + body, "dbc")
    frame = data.draw(raws(codec.message("M")))
    expected = oracle.encode_message("M", frame, scaling=False, strict=False)
    packed = codec.pack("M", frame)
    assert packed.tobytes() == expected
    assert {key: int(raw[0]) for key, raw in codec.unpack("M", packed).items()} == frame
    assert codec.decode("M", expected) == oracle.decode_message("M", expected)


@EACH
@given(data=st.data())
def test_physical_round_trip(name, data):
    """The physical value of a raw value becomes that raw value again."""
    for signal in CODEC.message(name).signals.values():
        raw = data.draw(st.integers(signal.raw_min, signal.raw_max))
        assert signal.to_raw(signal.to_physical(raw)) == raw


def test_halves_round_to_even():
    """A physical value half-way between two raw ones goes to the even one."""
    alive = CODEC.message("STROKES").signals["alive"]
    assert alive.to_raw([0.5, 1.5, 2.5, 3.5]).tolist() == [0, 2, 2, 4]


@given(st.floats(allow_nan=False))
def test_out_of_range_saturates(value):
    """No physical value but NaN is refused: what the bits cannot carry is saturated before packing."""
    for signal in CODEC.message("MOTION").signals.values():
        raw = int(signal.to_raw(value))
        assert signal.raw_min <= raw <= signal.raw_max
        if value / signal.scale > signal.raw_max:
            assert raw == signal.raw_max
        if value / signal.scale < signal.raw_min:
            assert raw == signal.raw_min


def test_raw_out_of_range_saturates():
    """A raw value that the bits cannot carry is saturated too, and spills into no neighbour."""
    packed = CODEC.pack("STROKES", {"fork_stroke_mm": [5000, -7], "rear_stroke_mm": 0, "alive": 0})
    assert CODEC.unpack("STROKES", packed)["fork_stroke_mm"].tolist() == [4095, 0]
    assert CODEC.unpack("STROKES", packed)["rear_stroke_mm"].tolist() == [0, 0]


def test_encode_is_round_and_pack():
    """Encoding physical values gives the bytes of their rounded raw values."""
    packed = CODEC.encode("MOTION", {"pitch_rate_dps": [-1.0, 9e9], "speed_kmh": 120.004, "alive": 3})
    decoded = CODEC.unpack("MOTION", packed)
    assert decoded["pitch_rate_dps"].tolist() == [-114, 32767]
    assert decoded["speed_kmh"].tolist() == [12000, 12000]
    assert decoded["alive"].tolist() == [3, 3]


def test_nan_is_refused():
    """NaN has no raw value: the error names the signal."""
    with pytest.raises(BusError, match="speed_kmh is nan"):
        CODEC.message("MOTION").signals["speed_kmh"].to_raw([1.0, float("nan")])


def test_message_by_name_and_id():
    """A message is found by name and by identifier, with its cycle, sender, length and limits."""
    message = CODEC.message(0x101)
    assert message is CODEC.message("MOTION")
    assert (message.length, message.cycle_ms, message.senders) == (5, 10, ("MDLOG",))
    speed = message.signals["speed_kmh"]
    assert (speed.low, speed.high, speed.unit, speed.raw_max) == (0.0, 300.0, "km/h", 65535)
    assert [m.name for m in CODEC.messages()] == [m.name for m in ORACLE.messages]


def test_longer_payload_is_cut():
    """Bytes beyond the message's length are ignored, as a receiver does."""
    assert CODEC.decode("STROKES", b"\x01\x02\x03\x04\xff") == CODEC.decode("STROKES", b"\x01\x02\x03\x04")


@pytest.mark.parametrize(
    ("act", "says"),
    [
        (lambda: CODEC.message("NOPE"), "no message NOPE; the known ones are STROKES"),
        (lambda: CODEC.message(0x7FF), "no message 0x7ff"),
        (lambda: CODEC.message(0x101, extended=True), "no message 0x101"),
        (lambda: CODEC.pack("STROKES", {"alive": 1}), "STROKES lacks fork_stroke_mm, rear_stroke_mm"),
        (lambda: CODEC.decode("STROKES", b"123"), "STROKES has 4 bytes; a payload of 3"),
        (lambda: CODEC.unpack("STROKES", np.zeros((1, 3), np.uint8)), "a payload of 3"),
        (
            lambda: CODEC.pack("STROKES", {"fork_stroke_mm": 1.5, "rear_stroke_mm": 0, "alive": 0}),
            "fork_stroke_mm: raw values are integers",
        ),
        (
            lambda: CODEC.pack("STROKES", {"x": 0, "fork_stroke_mm": 1, "rear_stroke_mm": 0, "alive": 0}),
            "no signal x",
        ),
        (lambda: Codec(Path("none/such.dbc")), "such.dbc: No such file"),
    ],
)
def test_refused(act, says):
    """What the layout does not have is refused with a line that names it."""
    with pytest.raises(BusError, match=says):
        act()


@pytest.mark.parametrize(
    ("body", "says"),
    [
        ('BO_ 1 M: 8 NODE\n SG_ s : 0|64@1+ (1,0) [0|0] "" NODE\n', "of 64 bits"),
        ('BO_ 1 M: 2 NODE\n SG_ s : 12|8@1+ (1,0) [0|0] "" NODE\n', "the signal s beyond its end"),
        ('BO_ 1 M: 2 NODE\n SG_ s : 11|8@0+ (1,0) [0|0] "" NODE\n', "the signal s beyond its end"),
        ('BO_ 1 M: 64 NODE\n SG_ s : 0|8@1+ (1,0) [0|0] "" NODE\n', "64 bytes"),
        ('BO_ 1 M: 8 NODE\n SG_ s : 0|32@1- (1,0) [0|0] "" NODE\nSIG_VALTYPE_ 1 s : 1;\n', "float signal s"),
        (
            'BO_ 1 M: 1 NODE\n SG_ m M : 0|2@1+ (1,0) [0|0] "" X\n SG_ s m0 : 2|2@1+ (1,0) [0|0] "" X\n',
            "is multiplexed",
        ),
    ],
)
def test_unsupported_messages_are_refused_when_used(dbc, body, says):
    """A foreign DBC loads; a message it cannot handle is refused by name when it is asked for."""
    codec = Codec(dbc(body + 'BO_ 2 GOOD: 1 NODE\n SG_ g : 0|8@1+ (1,0) [0|0] "" NODE\n'))
    assert codec.message("GOOD").id == 2
    with pytest.raises(BusError, match=says):
        codec.message("M")


def test_not_a_dbc(dbc):
    """A file that is no DBC is refused in one line with its path."""
    with pytest.raises(BusError, match=r"layout\.dbc: not a DBC file") as refusal:
        Codec(dbc("BO_ what is this"))
    assert "\n" not in str(refusal.value)
