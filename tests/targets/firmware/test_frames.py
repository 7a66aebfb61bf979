"""The firmware's frames: generated from the DBC, and read and written as the bench's own codec does."""

import ctypes

import numpy as np
import pytest

from bench.codec import Codec
from bench.mdlog.logger import schedule
from bench.sensors.codes import acquire
from dbc import CHANNELS
from targets.errors import FirmwareError
from targets.firmware.frames import HEADER, generate
from tests.conftest import wavy_lap

CODEC = Codec()
OUTPUTS = [message for message in CODEC.messages() if not {"MDLOG", "BENCH"} & {*message.senders}]

SETTERS = [
    (message.name, signal.name, signal.scale != 1)
    for message in OUTPUTS
    for signal in message.signals.values()
]


@pytest.fixture(scope="module")
def frames(compiled):
    """The header behind functions that ctypes can call."""
    lines = [
        '#include "frames.h"',
        "int read_frame(uint32_t, uint32_t, const uint8_t *, float *, uint32_t *);",
    ]
    lines += ["int read_frame(uint32_t id, uint32_t n, const uint8_t *d, float *c, uint32_t *alive) {"]
    lines += ["    return frames_read(id, n, d, c, alive);", "}"]
    for message, signal, physical in SETTERS:
        kind, name = "float" if physical else "uint32_t", f"{message.lower()}_set_{signal}"
        lines += [f"void call_{name}(uint8_t *, {kind});"]
        lines += [f"void call_{name}(uint8_t *d, {kind} v) {{ {name}(d, v); }}"]
    return ctypes.CDLL(str(compiled("frames.so", "\n".join(lines) + "\n", "-O2", "-shared", "-fPIC")))


def read(frames, identifier, data):
    """The message's number, the channels it wrote (NaN where it did not) and the count."""
    channels = (ctypes.c_float * len(CHANNELS))(*[float("nan")] * len(CHANNELS))
    alive = ctypes.c_uint32(99)
    number = frames.read_frame(
        identifier, len(data), (ctypes.c_uint8 * 8)(*data), channels, ctypes.byref(alive)
    )
    return number, dict(zip(CHANNELS, channels, strict=True)), alive.value


def test_header_is_the_one_generated():
    """core/frames.h is what the generator makes of dbc/motorcycle.dbc."""
    assert HEADER.read_text(encoding="utf-8") == generate()


DBC = """VERSION ""
NS_ :
BS_:
BU_: MDLOG IFD
BO_ 1 IN: 8 MDLOG
{inputs}
BO_ 2 OUT: 8 IFD
 SG_ y : {layout} (1,{offset}) [0|0] "" MDLOG
"""


@pytest.mark.parametrize(("layout", "offset"), [("7|8@0+", 0), ("0|33@1+", 0), ("0|8@1+", 5)])
def test_layout_the_firmware_does_not_know(tmp_path, layout, offset):
    """A Motorola signal, one of more than 32 bits and one with an offset are refused by name."""
    inputs = "".join(f' SG_ {name} : {8 * k}|8@1+ (1,0) [0|0] "" IFD\n' for k, name in enumerate(CHANNELS))
    path = tmp_path / "other.dbc"
    path.write_text(DBC.format(inputs=inputs, layout=layout, offset=offset))
    with pytest.raises(FirmwareError, match="signal y: the firmware reads little-endian signals"):
        generate(path)


def test_reads_what_the_logger_sends(frames):
    """Every frame of a lap is read as the codec decodes it, to the last bit of single precision."""
    numbers = {}
    for _, frame in schedule(acquire(wavy_lap(0.5)), CODEC):
        message = CODEC.message(frame.id)
        number, channels, alive = read(frames, frame.id, frame.data)
        numbers[frame.id] = number
        expected = CODEC.decode(message.name, frame.data)
        assert alive == expected.pop("alive")
        for name, value in expected.items():
            signal = message.signals[name]
            raw = np.float32(round((value - signal.offset) / signal.scale))
            assert channels[name] == raw * np.float32(signal.scale)
        assert all(np.isnan(value) for name, value in channels.items() if name not in expected)
    assert sorted(numbers.values()) == [0, 1, 2]


@pytest.mark.parametrize("value", [0, 0xFF])
def test_reads_the_ends_of_the_codes(frames, value):
    """Payloads of zeros and of ones give the smallest and the largest codes, signed ones extended."""
    for name in ("STROKES", "MOTION", "ACCELERATIONS"):
        message = CODEC.message(name)
        data = bytes([value]) * message.length
        _, channels, alive = read(frames, message.id, data)
        expected = CODEC.decode(name, data)
        assert alive == expected.pop("alive")
        for channel, physical in expected.items():
            assert channels[channel] == pytest.approx(physical, rel=2e-7)


@pytest.mark.parametrize(
    ("identifier", "length"), [(0x0FF, 4), (0x103, 5), (0x200, 7), (0x100, 3), (0x100, 5), (0x101, 0)]
)
def test_reads_nothing_else(frames, identifier, length):
    """Another identifier or another length is no message, and writes no channel."""
    number, channels, alive = read(frames, identifier, bytes(length))
    assert (number, alive) == (-1, 99)
    assert np.isnan(list(channels.values())).all()


def write(frames, message, signal, value, payload=b""):
    """The payload after one signal has been written into it."""
    data = (ctypes.c_uint8 * 8)(*payload.ljust(8, b"\0"))
    physical = CODEC.message(message).signals[signal].scale != 1
    given = ctypes.c_float(value) if physical else ctypes.c_uint32(int(value))
    getattr(frames, f"call_{message.lower()}_set_{signal}")(data, given)
    return bytes(data)[: CODEC.message(message).length]


def raw_of(message, payload):
    rows = np.frombuffer(payload, np.uint8)[None]
    return {name: int(values[0]) for name, values in CODEC.unpack(message, rows).items()}


@pytest.mark.parametrize(("message", "signal"), [setter[:2] for setter in SETTERS])
def test_writes_its_own_bits_only(frames, message, signal):
    """Each signal is written where the codec finds it, over ones and over zeros, and no other is touched."""
    found = CODEC.message(message).signals[signal]
    rng = np.random.default_rng(1)
    for raw in {0, 1, found.raw_max, *rng.integers(0, found.raw_max, 20).tolist()}:
        for payload in (bytes(8), bytes([0xFF] * 8), rng.bytes(8)):
            before = payload[: CODEC.message(message).length]
            after = write(frames, message, signal, raw * found.scale, before)
            assert raw_of(message, after) == {**raw_of(message, before), signal: raw}


@pytest.mark.parametrize(
    ("value", "raw"),
    [
        (-1.0, 0),
        (-0.0, 0),
        (float("nan"), 0),
        (float("-inf"), 0),
        (0.0009, 0),
        (0.0011, 1),
        (131.0699, 65535),
        (131.08, 65535),
        (1e30, 65535),
        (float("inf"), 65535),
    ],
)
def test_saturates(frames, value, raw):
    """What lies beyond the signal's bits, or is no number, becomes its nearest end, never a wrapped code."""
    assert raw_of("IFD_STATUS", write(frames, "IFD_STATUS", "predicted_mm", value))["predicted_mm"] == raw


def predicted(frames, values):
    """The codes of many predictions, in single precision."""
    payloads = [write(frames, "IFD_STATUS", "predicted_mm", value) for value in values.tolist()]
    return np.array([raw_of("IFD_STATUS", payload)["predicted_mm"] for payload in payloads])


def test_rounds_ties_to_even(frames):
    """A prediction half-way between two codes takes the even one, upwards as often as downwards."""
    step = np.float32(CODEC.message("IFD_STATUS").signals["predicted_mm"].scale)
    values = (np.arange(1000, dtype=np.float32) + np.float32(0.5)) * step
    ties = values[(values / step) % 1 == 0.5]
    codes = predicted(frames, ties)
    assert len(codes) > 100
    assert (codes % 2 == 0).all()
    assert {-0.5, 0.5} == set((codes - ties / step).tolist())


def test_rounds_as_the_codec(frames):
    """Single precision makes no other code than the codec's, save next to a tie, and then by one."""
    signal = CODEC.message("IFD_STATUS").signals["predicted_mm"]
    values = np.random.default_rng(2).uniform(0, 131, 2000).astype(np.float32)
    apart = np.abs(predicted(frames, values) - signal.to_raw(values))
    near_a_tie = np.abs(values.astype(np.float64) / signal.scale % 1 - 0.5) < 0.01
    assert (apart[~near_a_tie] == 0).all()
    assert apart.max() <= 1
