"""The data logger: what it sends when, and that a receiver decodes what the sensors said."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.codec import Codec
from bench.errors import LapError
from bench.laps.lap import Lap
from bench.mdlog.logger import sampled, sampled_codes, schedule
from bench.sensors.codes import Codes, acquire
from bench.sensors.transducers import TRANSDUCERS
from dbc import CHANNELS
from targets.ecu import Frame

MS = 1_000_000
CODEC = Codec()


def codes_of(t_ns, sensors=tuple(TRANSDUCERS), seed=0):
    random = np.random.default_rng(seed)
    rows = {name: TRANSDUCERS[name] for name in sensors}
    return Codes(
        np.array(t_ns, dtype=np.int64),
        {
            name: random.integers(row.code_min, row.code_max, len(t_ns), dtype=np.int32, endpoint=True)
            for name, row in rows.items()
        },
    )


def frames_of(plan, name):
    message = CODEC.message(name)
    mine = plan.ids == message.id
    return plan.t_ns[mine], CODEC.unpack(name, plan.payload[mine]), plan.cycle[mine]


def test_cycles_and_counter():
    """Every message of the logger goes out at 0, 10, 20 ... ms, numbered by alive modulo 16."""
    plan = schedule(codes_of(np.arange(400) * MS), CODEC)
    assert len(plan) == 3 * 40
    for name in ("STROKES", "MOTION", "ACCELERATIONS"):
        t_ns, raw, cycle = frames_of(plan, name)
        assert t_ns.tolist() == [10 * MS * k for k in range(40)]
        assert cycle.tolist() == list(range(40))
        assert raw["alive"].tolist() == [k % 16 for k in range(40)]


def test_last_cycle_at_the_last_sample():
    """A cycle due exactly at the last sample is sent, one due after it is not."""
    assert schedule(codes_of([0, 20 * MS]), CODEC).t_ns.max() == 20 * MS
    assert schedule(codes_of([0, 20 * MS - 1]), CODEC).t_ns.max() == 10 * MS


def test_order():
    """Frames come in the order of time, those of one instant in the order of their identifiers."""
    plan = schedule(codes_of(np.arange(50) * MS), CODEC)
    keys = list(zip(plan.t_ns.tolist(), plan.ids.tolist(), strict=True))
    assert keys == sorted(keys)


@given(st.lists(st.integers(1, 30 * MS), min_size=1, max_size=60), st.integers(0, 1000))
def test_sample_and_hold(gaps, seed):
    """Whatever the time base, a frame carries each sensor's latest code at or before its instant."""
    t_ns = [0, *np.cumsum(gaps).tolist()]
    codes = codes_of(t_ns, seed=seed)
    plan = schedule(codes, CODEC)
    for name in ("STROKES", "MOTION", "ACCELERATIONS"):
        instants, raw, _ = frames_of(plan, name)
        assert instants.tolist() == list(range(0, t_ns[-1] + 1, 10 * MS))
        latest = [max(k for k, t in enumerate(t_ns) if t <= instant) for instant in instants]
        for row in TRANSDUCERS.values():
            if row.channel in raw:
                assert raw[row.channel].tolist() == codes.codes[row.sensor][latest].tolist()


def test_sampled_is_what_the_ecu_decodes():
    """The decimated channels equal, bit for bit, what the frames decode to."""
    codes = codes_of(np.arange(1000) * MS)
    plan, channels = schedule(codes, CODEC), sampled(codes)
    assert set(channels) == set(CHANNELS)
    for name in ("STROKES", "MOTION", "ACCELERATIONS"):
        message = CODEC.message(name)
        decoded = CODEC.decode_all(name, plan.payload[plan.ids == message.id])
        for channel in set(decoded) - {"alive"}:
            assert np.array_equal(decoded[channel], channels[channel])


def test_sampled_at_another_rate():
    """Any rate with a period of whole nanoseconds can be sampled; another one is refused."""
    codes = codes_of(np.arange(1000) * MS)
    assert np.array_equal(sampled_codes(codes, 1000)["speed"], codes.codes["speed"])
    assert np.array_equal(sampled_codes(codes, 50)["speed"], codes.codes["speed"][::20])
    for rate_hz in (3, 0, -100):
        with pytest.raises(LapError, match=f"rate {rate_hz} Hz"):
            sampled_codes(codes, rate_hz)


def test_missing_channels_are_named():
    """A message is not sent when the lap lacks one of its channels, and the schedule says which."""
    plan = schedule(codes_of([0, MS], ["fork_stroke", "pitch_rate", "speed", "acc_body"]), CODEC)
    assert set(plan.ids.tolist()) == {CODEC.message("MOTION").id}
    assert plan.unsent == {
        "STROKES": ("rear_stroke_mm",),
        "ACCELERATIONS": ("acc_front_ms2", "acc_rear_ms2"),
    }


def test_nothing_to_send():
    """A lap with no message's channels gives an empty schedule that names every one of them."""
    plan = schedule(codes_of([0, MS], ["acc_body"]), CODEC)
    assert len(plan) == 0
    assert list(plan) == []
    assert set(plan.unsent) == {"STROKES", "MOTION", "ACCELERATIONS"}


def test_iterates_as_frames():
    """Iterating gives each instant with its frame, cut to the message's length."""
    codes = Codes(
        np.array([0]), {"fork_stroke": np.array([0x123], np.int32), "rear_stroke": np.array([0x456])}
    )
    assert list(schedule(codes, CODEC)) == [(0, Frame(0x100, b"\x23\x61\x45\x00"))]


def test_same_lap_same_bytes():
    """The same lap gives the same schedule, byte for byte, however it is based in time."""
    random = np.random.default_rng(3)
    channels = {name: random.normal(20.0, 30.0, 500) for name in CHANNELS}
    one = schedule(acquire(Lap(np.arange(500) * MS, channels)), CODEC)
    two = schedule(acquire(Lap(np.arange(500) * MS + 777, channels)), CODEC)
    for field in ("t_ns", "ids", "payload", "lengths", "cycle"):
        assert getattr(one, field).tobytes() == getattr(two, field).tobytes()


def test_messages_of_different_periods(tmp_path: Path):
    """A slower message is sent every so many cycles and bears the number of the cycle it is sent in."""
    signal = ' SG_ speed_kmh : 0|16@1+ (0.01,0) [0|300] "" X\n SG_ alive : 16|4@1+ (1,0) [0|15] "" X\n'
    path = tmp_path / "two.dbc"
    path.write_text(
        'VERSION ""\nBU_: MDLOG X\n'
        f"BO_ 1 FAST: 3 MDLOG\n{signal}\nBO_ 2 SLOW: 3 MDLOG\n{signal}\nBO_ 3 OTHER: 3 X\n{signal}\n"
        'BA_DEF_ BO_ "GenMsgCycleTime" INT 0 65535;\nBA_DEF_DEF_ "GenMsgCycleTime" 0;\n'
        'BA_ "GenMsgCycleTime" BO_ 1 10;\nBA_ "GenMsgCycleTime" BO_ 2 20;\nBA_ "GenMsgCycleTime" BO_ 3 10;\n',
        encoding="ascii",
    )
    codec = Codec(path)
    plan = schedule(codes_of(np.arange(41) * MS, ["speed"]), codec)
    sent = {1: [], 2: []}
    for t_ns, frame in plan:
        name = {1: "FAST", 2: "SLOW"}[frame.id]
        sent[frame.id].append((t_ns // MS, codec.decode(name, frame.data)["alive"]))
    assert sent[1] == [(0, 0), (10, 1), (20, 2), (30, 3), (40, 4)]
    assert sent[2] == [(0, 0), (20, 2), (40, 4)]
