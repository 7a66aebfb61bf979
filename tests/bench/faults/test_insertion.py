"""Fault insertion: what each kind makes of the codes, and the ground truth the rig is given."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.errors import FaultError
from bench.faults.insertion import insert
from bench.faults.kinds import KINDS, SensorKind
from bench.faults.places import POTENTIOMETERS, places
from bench.faults.spec import FaultSpec, parse_fault
from bench.sensors.codes import Codes
from bench.sensors.transducers import TRANSDUCERS

MS = 1_000_000


def codes_of(sensor, values):
    return Codes(np.arange(len(values)) * MS, {sensor: np.array(values, dtype=np.int32)})


def run(text, values):
    spec = parse_fault(text)
    faulty, (insertion,) = insert(codes_of(spec.sensor, values), [spec])
    return faulty.codes[spec.sensor].tolist(), insertion


@pytest.mark.parametrize(
    ("text", "values", "faulty"),
    [
        ("rear_stroke:open@0.002", [100, 200, 300, 400], [100, 200, 4095, 4095]),
        ("pitch_rate:open@0.001", [-5, 5], [-5, 28571]),
        ("rear_stroke:short@0.002", [100, 200, 300, 400], [100, 200, 0, 0]),
        ("pitch_rate:short@0.001", [-5, 5], [-5, -28571]),
        ("rear_stroke:short:to=batt@0.002", [100, 200, 300, 400], [100, 200, 4095, 4095]),
        ("rear_stroke:hold@0.002", [100, 200, 300, 400], [100, 200, 200, 200]),
        ("rear_stroke:hold@0", [100, 200, 300], [100, 100, 100]),
        ("rear_stroke:hold@0.001+0.001", [100, 200, 300], [100, 100, 300]),
        ("rear_stroke:uncalibration@0.001", [1000, 1000, 25, 35], [1000, 1100, 28, 38]),
        ("rear_stroke:uncalibration:gain=1.5@0", [1, 3, 4000], [2, 4, 4095]),
        ("pitch_rate:uncalibration:gain=2@0", [-20000, -3, 3, 20000], [-28571, -6, 6, 28571]),
    ],
)
def test_kinds(text, values, faulty):
    """Each kind drives the codes from the first sample at or after its time, and only while it lasts."""
    assert run(text, values)[0] == faulty


PLACED = [
    (name, sensor)
    for name, kind in KINDS.items()
    if isinstance(kind, SensorKind)
    for sensor in places(kind.where)
]


@given(
    st.sampled_from(PLACED),
    st.lists(st.floats(0, 1), min_size=1, max_size=30),
    st.integers(0, 29 * MS),
    st.none() | st.integers(1, 10**12),
)
def test_only_the_window_and_the_range(placed, where, t_ns, duration_ns):
    """Whatever the fault, codes outside its window stay and all codes stay in the sensor's range."""
    kind, sensor = placed
    row = TRANSDUCERS[sensor]
    healthy = np.rint(row.code_min + np.array(where) * (row.code_max - row.code_min)).astype(np.int32)
    codes = replace(codes_of(sensor, healthy), codes=dict.fromkeys((*POTENTIOMETERS, sensor), healthy))
    t_ns = min(t_ns, int(codes.t_ns[-1]))
    faulty, (truth,) = insert(codes, [FaultSpec(sensor, kind, (), t_ns, duration_ns)])
    after = faulty.codes[sensor]
    end_ns = t_ns + duration_ns if duration_ns else 10**18
    inside = (codes.t_ns >= t_ns) & (codes.t_ns < end_ns)
    assert after.dtype == np.int32
    assert np.array_equal(after[~inside], healthy[~inside])
    assert after.min() >= row.code_min
    assert after.max() <= row.code_max
    differs = np.flatnonzero(after != healthy)
    assert truth.t_active_ns == (int(codes.t_ns[differs[0]]) if differs.size else None)


def test_healthy_codes_are_left_alone():
    """Insertion gives new codes: the healthy ones stay as they were, other sensors are the same arrays."""
    speed = np.array([1, 2], dtype=np.int32)
    stroke = np.array([7, 7], dtype=np.int32)
    codes = Codes(np.array([0, MS]), {"rear_stroke": stroke, "speed": speed})
    faulty, _ = insert(codes, [parse_fault("rear_stroke:open@0")])
    assert stroke.tolist() == [7, 7]
    assert faulty.codes["speed"] is speed


def test_active_before_observable():
    """A slight gain error is active at the first changed code, observable only beyond the tolerance."""
    _, truth = run("rear_stroke:uncalibration:gain=1.01@0.001", [2000, 10, 60, 1000, 1100])
    assert (truth.t_cmd_ns, truth.t_active_ns, truth.t_obs_ns) == (1 * MS, 2 * MS, 4 * MS)


def test_command_between_samples():
    """A fault commanded between two samples acts from the later one."""
    values, truth = run("rear_stroke:open@0.0015", [5, 5, 5, 5])
    assert values == [5, 5, 4095, 4095]
    assert (truth.t_cmd_ns, truth.t_active_ns) == (1_500_000, 2 * MS)


@pytest.mark.parametrize("text", ["speed:open@0.001", "speed:open@0.001+9", "speed:open@0.001+999999999"])
def test_to_the_last_sample(text):
    """A fault without an end, or with one past the lap's, acts to the last sample."""
    assert run(text, [5, 5, 5])[0] == [5, 30000, 30000]


def test_never_active():
    """A hold on a signal that does not move changes nothing: it was never active, never observable."""
    _, truth = run("rear_stroke:hold@0.001", [42, 42, 42])
    assert (truth.t_active_ns, truth.t_obs_ns) == (None, None)


def test_shorter_than_a_sample():
    """A fault that begins and ends between two samples has not acted."""
    values, truth = run("rear_stroke:open@0.0011+0.0005", [42, 42, 42])
    assert values == [42, 42, 42]
    assert truth.t_active_ns is None


def test_overlapping_faults_compose_in_order():
    """Two faults of one sensor compose in the order given, and each reports what it changed itself."""
    codes = codes_of("rear_stroke", [100, 200, 300, 400])
    gain, hold = parse_fault("rear_stroke:uncalibration:gain=2@0.001"), parse_fault("rear_stroke:hold@0.002")
    faulty, truths = insert(codes, [gain, hold])
    assert faulty.codes["rear_stroke"].tolist() == [100, 400, 400, 400]
    assert [truth.t_active_ns for truth in truths] == [1 * MS, 2 * MS]
    faulty, _ = insert(codes, [hold, gain])
    assert faulty.codes["rear_stroke"].tolist() == [100, 400, 400, 400]
    short = parse_fault("rear_stroke:short@0.002")
    faulty, truths = insert(codes, [short, gain])
    assert faulty.codes["rear_stroke"].tolist() == [100, 400, 0, 0]
    faulty, truths = insert(codes, [short, short])
    assert [truth.t_active_ns for truth in truths] == [2 * MS, None]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("speed:open@0.001", "speed:open@0.001: the lap lacks speed_kmh; its sensors are rear_stroke"),
        ("rear_stroke:open@0.0021", "rear_stroke:open@0.0021: the lap ends at 0.002 s"),
        ("rear_stroke:open@999999999", "the lap ends at 0.002 s"),
        ("rear_stroke:short_pin@0", "rear_stroke:short_pin:to=signal@0: the lap lacks fork_stroke_mm"),
        ("STROKES:frame_loss@0", "STROKES:frame_loss:rate=0.2@0: acts on the bus, not on a sensor"),
        ("rear_stroke:open@sector=1/2", "rear_stroke:open@sector=1/2: begins or ends on a condition"),
        ("rear_stroke:open@0+when=speed_kmh>1", "begins or ends on a condition"),
    ],
)
def test_refused(text, says):
    """A fault past the lap's end or on a channel it lacks is refused by name."""
    with pytest.raises(FaultError, match=says):
        insert(codes_of("rear_stroke", [1, 2, 3]), [parse_fault(text)])
