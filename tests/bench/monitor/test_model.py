"""The monitor: frames in, one look out."""

import math

import pytest

from bench.bus.bits import frame_bits
from bench.codec import Codec
from bench.monitor.detection import Told
from bench.monitor.model import Monitor
from targets.ecu import Frame
from tests.bench.monitor.conftest import MS


@pytest.fixture
def monitor(codec):
    return Monitor(codec, threshold_pct=10.0)


def ride(monitor, frame, cycles, alarm=(), skip=(), start=0):
    """Cycles of 10 ms: strokes, the IFD's answer and its timing; `alarm`: cycles with the alarm up."""
    for k in range(start, start + cycles):
        if k in skip:
            continue
        t_ns, alive = k * 10 * MS, k % 16
        monitor.heard(t_ns, frame("STROKES", rear_stroke_mm=40, alive=alive))
        status = {"predicted_mm": 42, "residual_pct": 5, "alarm": k in alarm, "kind": k in alarm}
        monitor.heard(t_ns + MS, frame("IFD_STATUS", alive=alive, **status))
        monitor.heard(t_ns + MS, frame("IFD_TIMING", alive=alive, step_cycles=22_000 + k, overruns=3))
    return monitor.look((start + cycles) * 10 * MS)


def test_nothing_heard(monitor):
    """A silent bus is a look with nothing in it."""
    look = monitor.look(5_000 * MS)
    assert (look.frames, look.per_s, look.load) == (0, 0, 0)
    assert (look.signals, look.messages, look.ecus, look.complaints) == ((), (), (), ())


def test_rates_and_load(monitor, frame):
    """Rates are those of the last second, the load its bits with intermissions over the bit rate."""
    look = ride(monitor, frame, 200)
    rows = {row.name: row for row in look.messages}
    assert [row.per_s for row in look.messages] == [100, 100, 100]
    assert (rows["STROKES"].due_per_s, rows["IFD_STATUS"].due_per_s) == (100, None)
    assert rows["STROKES"].mean_per_s == pytest.approx(100)
    assert look.per_s == 300
    bits = 0
    for alive in range(100, 200):
        bits += frame_bits(*frame("STROKES", rear_stroke_mm=40, alive=alive % 16)) + 3
        bits += frame_bits(*frame("IFD_STATUS", predicted_mm=42, residual_pct=5, alive=alive % 16)) + 3
        timing = frame("IFD_TIMING", alive=alive % 16, step_cycles=22_000 + alive, overruns=3)
        bits += frame_bits(*timing) + 3
    assert look.load == pytest.approx(bits / 500_000)


def test_signals(monitor, frame):
    """Every signal has a row with its unit, but counters and what the ECU's row shows."""
    look = ride(monitor, frame, 10)
    assert [(row.message, row.name, row.unit) for row in look.signals] == [
        ("STROKES", "fork_stroke_mm", "mm"),
        ("STROKES", "rear_stroke_mm", "mm"),
        ("IFD_STATUS", "predicted_mm", "mm"),
        ("IFD_STATUS", "residual_pct", "%"),
    ]
    assert look.signals[2].value == pytest.approx(42)


def test_lost_frames(monitor, frame):
    """Cycles that are missing show in the counter of each message."""
    look = ride(monitor, frame, 50, skip={20, 21, 30})
    assert [(row.lost, row.repeats) for row in look.messages] == [(3, 0)] * 3
    assert (look.lost, look.repeats) == (9, 0)
    assert look.complaints == ()


@pytest.mark.parametrize("phase", [0, 5])
def test_two_senders(monitor, frame, phase):
    """Two loggers on one bus make nonsense of the counter, in phase or out of it; the monitor says so."""
    for k in range(40):
        monitor.heard(k * 10 * MS, frame("STROKES", alive=k % 16))
        monitor.heard(k * 10 * MS + MS, frame("STROKES", alive=(k + phase) % 16))
    assert any(line.startswith("STROKES: its counter jumps") for line in monitor.look(400 * MS).complaints)


def test_another_dbc(monitor, frame):
    """A frame of another length than the DBC says is counted, named and not decoded."""
    monitor.heard(0, frame("STROKES", rear_stroke_mm=40))
    for k in range(3):
        monitor.heard(k * MS, Frame(0x100, b"\xff" * 8))
    look = monitor.look(10 * MS)
    assert look.complaints == ("STROKES has 8 bytes, motorcycle.dbc says 4: another DBC (3 frames)",)
    assert look.messages[0].wrong == 3
    assert look.signals[1].high == pytest.approx(40, abs=0.02)


def test_unknown_frames(monitor):
    """Identifiers the DBC does not have are counted, within bounds; 29 bits are not their 11-bit twin."""
    for k in range(3000):
        monitor.heard(k * MS, Frame(0x10000 + k, b"", True))
    monitor.heard(3000 * MS, Frame(0x100, bytes(4), True))
    look = monitor.look(3000 * MS)
    assert (look.frames, look.unknown, look.messages) == (3001, 3001, ())
    assert look.unknown_ids == 1024


def test_ecu(monitor, frame):
    """The ECU's row: residual against threshold, step time at the clock, load, what it counts since then."""
    look = ride(monitor, frame, 200)
    (ecu,) = look.ecus
    assert (ecu.role, ecu.answers, ecu.threshold_pct) == ("ifd", 200, 10.0)
    assert (ecu.predicted_mm, ecu.residual_pct) == (pytest.approx(42), pytest.approx(5))
    assert ecu.step_s == pytest.approx(22_199 / 22e6)
    assert ecu.worst_step_s == pytest.approx(22_199 / 22e6)
    assert ecu.load == pytest.approx(ecu.step_s * 100)
    assert (ecu.missed_inputs, ecu.overruns) == (0, 0)
    assert (ecu.alarm, ecu.alarms, ecu.since_s, ecu.td_s) == (False, 0, None, None)


def test_alarm(monitor, frame):
    """An alarm is up from its first frame to the first without it, with the kind it named."""
    (ecu,) = ride(monitor, frame, 60, alarm=range(50, 55)).ecus
    assert (ecu.alarm, ecu.kind, ecu.alarms) == (False, "open", 1)
    assert ecu.since_s == pytest.approx(0.600 - 0.551)
    (ecu,) = ride(monitor, frame, 10, alarm=range(64, 100), start=60).ecus
    assert (ecu.alarm, ecu.alarms) == (True, 2)
    assert ecu.since_s == pytest.approx(0.700 - 0.641)


def test_time_to_detect(monitor, frame):
    """With the replay's word on when the fault acted the alarm has its time to detect."""
    row = {"number": 0, "spec": "rear_stroke:open@7.2", "state": "active", "t_active_s": 7.21}
    for t_ms in (0, 500):
        monitor.detection.told(t_ms * MS, Told.of({"t_s": 7 + t_ms / 1e3, "faults": [row]}))
    (ecu,) = ride(monitor, frame, 60, alarm=range(25, 60)).ecus
    assert ecu.td_s == pytest.approx(7.251 - 7.21)


def test_flapping_alarm(monitor, frame):
    """Alarms beyond those kept are still counted, and the memory for them does not grow."""
    (ecu,) = ride(monitor, frame, 400, alarm=range(0, 400, 2)).ecus
    assert ecu.alarms == 200
    watch = monitor._ecus["ifd"]._watch
    assert max(len(watch.alarms), len(watch.answers), len(watch.step_cycles)) <= 16


def test_time_never_runs_backwards(monitor, frame):
    """A frame with an earlier instant, and a look before the last frame, count as of the last one."""
    monitor.heard(500 * MS, frame("STROKES", alive=1))
    monitor.heard(400 * MS, frame("STROKES", alive=2), age_ns=70)
    look = monitor.look(0)
    assert (look.t_ns, look.messages[0].age_ns, look.worst_age_ns) == (500 * MS, 0, 70)


def test_dropped(monitor):
    """What the kernel threw away is said."""
    monitor.dropped = 17
    assert monitor.look(0).complaints == ("17 frames dropped by the kernel: read too slowly",)


def test_dbc_without_an_ecu(tmp_path):
    """A DBC that knows no ECU of ours is a monitor without its rows; empty messages are only counted."""
    path = tmp_path / "other.dbc"
    path.write_text(
        'VERSION ""\nBU_: A\nBO_ 16 PING: 0 A\nBO_ 17 TEMP: 1 A\n'
        ' SG_ oil : 0|8@1+ (1,-40) [-40|215] "degC" A\n'
    )
    monitor = Monitor(Codec(path))
    monitor.heard(0, Frame(16, b""))
    monitor.heard(0, Frame(17, b"\x64"))
    look = monitor.look(MS)
    assert [(row.name, row.frames, row.lost) for row in look.messages] == [
        ("PING", 1, None),
        ("TEMP", 1, None),
    ]
    assert [(row.name, row.value) for row in look.signals] == [("oil", 60)]
    assert look.ecus == ()
    assert not math.isnan(look.load)
