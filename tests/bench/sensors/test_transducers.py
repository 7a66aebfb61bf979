"""The transducers of Table II.1: codes, saturation, and the DBC's scale as the worth of a code."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.codec import Codec
from bench.errors import LapError
from bench.laps.lap import Lap
from bench.sensors.codes import Codes, acquire
from bench.sensors.transducers import BY_CHANNEL, TRANSDUCERS
from dbc import CHANNELS

EACH = pytest.mark.parametrize("row", TRANSDUCERS.values(), ids=TRANSDUCERS)


@EACH
def test_scale_of_dbc(row):
    """The raw value of a CAN signal is its transducer's code: scale, offset and range of the DBC agree."""
    carriers = [m.signals[row.channel] for m in Codec().messages() if row.channel in m.signals]
    assert carriers
    for signal in carriers:
        assert (signal.scale, signal.offset) == (row.per_code, 0.0)
        assert signal.raw_min <= row.code_min < row.code_max <= signal.raw_max
        assert (signal.low, signal.high) == (row.low, row.high)


def test_every_channel_has_a_transducer():
    """Every lap channel of section II.5 is measured by exactly one sensor named like it."""
    assert tuple(BY_CHANNEL) == CHANNELS
    assert all(row.channel.rpartition("_")[0] == row.sensor for row in TRANSDUCERS.values())


@EACH
def test_ends_of_the_span(row):
    """The two ends of a sensor's span give its two end codes and are no saturation."""
    codes, saturated = row.to_codes([row.low, row.high])
    assert codes.dtype == np.int32
    assert codes.tolist() == [row.code_min, row.code_max]
    assert saturated == 0


@EACH
@given(data=st.data())
def test_back_within_half_a_code(row, data):
    """A value within the span comes back from its code within half a code."""
    value = data.draw(st.floats(row.code_min * row.per_code, row.code_max * row.per_code))
    codes, saturated = row.to_codes([value])
    assert saturated == 0
    assert abs(row.to_physical(codes)[0] - value) <= row.per_code * (0.5 + 1e-6)


@EACH
def test_codes_survive_the_round_trip(row):
    """Every code of a sensor is the code of the value a receiver decodes from it."""
    codes = np.arange(row.code_min, row.code_max + 1, dtype=np.int32)
    assert np.array_equal(row.to_codes(row.to_physical(codes))[0], codes)


@EACH
def test_beyond_the_span_saturates(row):
    """Values beyond the span give the end codes, and each is counted."""
    far = 1e300
    codes, saturated = row.to_codes([-far, row.low - row.per_code, row.high + row.per_code, np.inf])
    assert codes.tolist() == [row.code_min, row.code_min, row.code_max, row.code_max]
    assert saturated == 4


def test_halves_round_to_even():
    """A speed half-way between two codes goes to the even one."""
    assert TRANSDUCERS["speed"].to_codes([0.005, 0.015, 0.025])[0].tolist() == [0, 2, 2]


def test_nan_is_refused():
    """NaN has no code: the error names the channel."""
    with pytest.raises(LapError, match="rear_stroke_mm is nan"):
        TRANSDUCERS["rear_stroke"].to_codes([1.0, np.nan])


def test_potentiometer_is_ratiometric():
    """Half the stroke is half of the converter's counts, whatever the supply."""
    assert TRANSDUCERS["fork_stroke"].to_codes([75.0 + 1e-6])[0].tolist() == [2048]


def test_acquire_rebases_and_names():
    """Acquiring a lap gives one code array per sensor, from t = 0 at the lap's first sample."""
    t_ns = np.array([5_000_000, 6_000_000, 8_000_000])
    codes = acquire(Lap(t_ns, {"rear_stroke_mm": [0.0, 55.0, 200.0], "speed_kmh": [1.0, 2.0, 3.0]}))
    assert codes.t_ns.tolist() == [0, 1_000_000, 3_000_000]
    assert {name: array.tolist() for name, array in codes.codes.items()} == {
        "rear_stroke": [0, 2048, 4095],
        "speed": [100, 200, 300],
    }
    assert codes.saturated == {"rear_stroke": 1, "speed": 0}


@pytest.mark.parametrize(
    ("t_ns", "code", "message"),
    [([5, 6], [1, 2], "start at t = 0"), ([0, 1], [1], "1 codes for 2")],
)
def test_codes_are_checked(t_ns, code, message):
    """Codes that do not start at 0 or do not fill their time base cannot be built."""
    with pytest.raises(ValueError, match=message):
        Codes(np.array(t_ns), {"speed": np.array(code, dtype=np.int32)})
