"""The kinds that act in a sensor's signal: the law of each on counts, and that none looks ahead."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.faults.insertion import insert
from bench.faults.kinds import KINDS, SensorKind
from bench.faults.places import POTENTIOMETERS, places
from bench.faults.spec import FaultSpec, parse_fault
from bench.sensors.codes import Codes
from bench.sensors.transducers import TRANSDUCERS

MS = 1_000_000
PLACED = [
    (name, sensor)
    for name, kind in KINDS.items()
    if isinstance(kind, SensorKind)
    for sensor in places(kind.where)
]
REAR = TRANSDUCERS["rear_stroke"]


def codes_of(values, sensors=("rear_stroke",), step_ns=MS):
    array = np.array(values, dtype=np.int32)
    return Codes(np.arange(len(array)) * step_ns, dict.fromkeys(sensors, array))


def faulty(text, values, step_ns=MS):
    spec = parse_fault(text)
    codes, _ = insert(codes_of(values, (*POTENTIOMETERS, spec.sensor), step_ns), [spec])
    return codes.codes[spec.sensor]


@given(
    st.sampled_from(PLACED),
    st.lists(st.floats(0, 1), min_size=2, max_size=60),
    st.data(),
    st.sampled_from((1, 7, 1000)),
)
def test_no_kind_looks_ahead(placed, where, data, step_ms):
    """A lap that ends earlier has the same faulty codes as far as it goes, and so has a shorter fault."""
    name, sensor = placed
    row = TRANSDUCERS[sensor]
    values = np.rint(row.code_min + np.array(where) * (row.code_max - row.code_min))
    codes = codes_of(values, (*POTENTIOMETERS, sensor), step_ms * MS)
    params = (("noise", 3.0),) if name == "hold" else ()
    last = data.draw(st.integers(1, len(values)))
    t_cmd = data.draw(st.integers(0, int(codes.t_ns[last - 1])))
    whole, _ = insert(codes, [FaultSpec(sensor, name, params, t_cmd)])
    short = Codes(codes.t_ns[:last], {key: array[:last] for key, array in codes.codes.items()})
    cut, _ = insert(short, [FaultSpec(sensor, name, params, t_cmd)])
    assert np.array_equal(cut.codes[sensor], whole.codes[sensor][:last])
    lasts = data.draw(st.integers(1, 60 * step_ms * MS))
    ended, _ = insert(codes, [FaultSpec(sensor, name, params, t_cmd, lasts)])
    acting = codes.t_ns < t_cmd + lasts
    assert np.array_equal(ended.codes[sensor][acting], whole.codes[sensor][acting])


@pytest.mark.parametrize("name", ["noise", "spike", "loose_contact", "hold:noise=2"])
def test_chance_comes_from_the_seed(name):
    """The same fault draws the same, one of another seed or instant does not."""
    values, more = np.full(3000, 2000), "," if ":" in name else ":"
    first = faulty(f"rear_stroke:{name}@0.5", values)
    assert np.array_equal(first, faulty(f"rear_stroke:{name}@0.5", values))
    assert not np.array_equal(first, faulty(f"rear_stroke:{name}{more}seed=1@0.5", values))
    later = faulty(f"rear_stroke:{name}@0.501", values)
    assert not np.array_equal(first[500:-1], later[501:])


def test_hold_in_noise():
    """Held codes scatter about the last good one with the sigma asked for, also below zero."""
    held = faulty("pitch_rate:hold:noise=3@0.001", [-500] + [4000] * 20_000)[1:] + 500
    assert abs(held.mean()) < 0.1
    assert held.std() == pytest.approx(np.sqrt(9 + 1 / 12), rel=0.02)


def test_offset():
    """An offset is so many units of the channel on each code."""
    assert faulty("rear_stroke:offset:by=-2@0.001", [1000, 1000, 30]).tolist() == [1000, 926, 0]


@given(st.floats(-50, 50), st.integers(0, 4095))
def test_drift_grows_evenly(rate, code):
    """After t seconds of drift a code has moved by rate * t, rounded and saturated."""
    codes = faulty(f"rear_stroke:drift:rate={rate!r}@0.1", np.full(1000, code))
    t_s = np.maximum(np.arange(1000) * 1e-3 - 0.1, 0.0)
    law = np.clip(code + rate * t_s / REAR.per_code, 0, 4095)
    assert np.abs(codes - law).max() <= 0.5 + 1e-6


def test_noise_is_white_gaussian():
    """Noise has the sigma asked for, no mean and no memory."""
    error = faulty("rear_stroke:noise:sigma=2@0", np.full(50_000, 2000)) - 2000
    sigma = 2 / REAR.per_code
    assert abs(error.mean()) < 4 * sigma / np.sqrt(50_000)
    assert error.std() == pytest.approx(sigma, rel=0.02)
    assert abs(np.corrcoef(error[1:], error[:-1])[0, 1]) < 0.02
    assert np.mean(np.abs(error) < 2 * sigma) == pytest.approx(0.9545, abs=0.005)


def test_spikes():
    """Spikes are of the height and width asked for, up and down alike, so many a second."""
    error = faulty("rear_stroke:spike:rate=5,height=20,width=0.004@0", np.full(200_000, 2000)) - 2000
    height = round(20 / REAR.per_code)
    assert set(np.unique(error)) == {-height, 0, height}
    begins = np.flatnonzero((error != 0) & np.concatenate(([True], error[:-1] == 0)))
    assert len(begins) == pytest.approx(5 * 200, rel=0.1)
    assert np.mean(error[begins] > 0) == pytest.approx(0.5, abs=0.06)
    assert np.count_nonzero(error) == pytest.approx(4 * len(begins), rel=0.05)


@pytest.mark.parametrize(("pull", "reads"), [("up", 4095), ("down", 0)])
def test_loose_contact(pull, reads):
    """The contact is open for its share of the time, as often a second as asked for; open reads the pull."""
    codes = faulty(
        f"rear_stroke:loose_contact:frequency=4,duty=0.25,pull={pull}@0", np.full(500_000, 2000), 200_000
    )
    opened = codes == reads
    assert np.array_equal(codes[~opened], np.full(np.count_nonzero(~opened), 2000))
    assert opened.mean() == pytest.approx(0.25, abs=0.03)
    assert np.count_nonzero(opened[1:] & ~opened[:-1]) == pytest.approx(400, rel=0.15)


def test_contact_that_never_and_always_opens():
    """A duty of 0 changes nothing, one of 1 is an open circuit."""
    values = np.arange(1000)
    assert np.array_equal(faulty("rear_stroke:loose_contact:duty=0@0.1", values), values)
    law = faulty("rear_stroke:open@0.1", values)
    assert np.array_equal(faulty("rear_stroke:loose_contact:duty=1@0.1", values), law)


@given(st.integers(0, 300), st.integers(0, 199))
def test_delay_is_the_signal_earlier(by_ms, start_ms):
    """A delayed code is the healthy one of so long ago, from before the fault too; at first the first."""
    values = np.random.default_rng(0).integers(0, 4096, 200)
    codes = faulty(f"rear_stroke:delay:by={by_ms / 1000!r}@{start_ms / 1000:.3f}", values)
    law = [values[max(k - by_ms, 0)] if k >= start_ms else values[k] for k in range(200)]
    assert codes.tolist() == law


def test_slow_is_a_first_order_lag():
    """A step comes through as 1 - exp(-t / tau), and the lag starts from the last healthy code."""
    values = np.concatenate((np.full(100, 1000), np.full(2000, 3000)))
    codes = faulty("rear_stroke:slow:tau=0.2@0.1", values)
    t_s = np.arange(2000) * 1e-3
    law = 3000 - 2000 * np.exp(-t_s / 0.2)
    assert np.abs(codes[100:] - law).max() <= 6
    assert codes[99:102].tolist()[0] == 1000
    assert abs(int(codes[100]) - 1000) <= 6


def test_slow_on_a_steady_signal():
    """A lag changes nothing of what does not move."""
    assert set(faulty("speed:slow@0.01", np.full(100, 1234))) == {1234}
