"""Triggers on a lap: the instants they come true at."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.errors import FaultError
from bench.faults.resolve import resolve
from bench.faults.spec import parse_fault
from bench.laps.lap import Lap

MS = 1_000_000


def lap_of(speed_kmh, start_ns=0, step_ms=100, **channels):
    t_ns = start_ns + np.arange(len(speed_kmh)) * step_ms * MS
    return Lap(t_ns, {"speed_kmh": np.array(speed_kmh, float), **channels})


def resolved(text, lap):
    spec = resolve(parse_fault(f"speed:{text}"), lap)
    assert spec.resolved
    assert parse_fault(str(spec)) == spec
    return str(spec).removeprefix("speed:")


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("open@0.3+0.1", "open@0.3+0.1"),
        ("open@when=speed_kmh>20", "open@0.3"),
        ("open@when=speed_kmh>=20", "open@0.2"),
        ("open@when=speed_kmh<10", "open@0"),
        ("open@when=speed_kmh>20,for=0.2", "open@0.5"),
        ("open@when=speed_kmh>25,for=0.1+0.05", "open@0.4+0.05"),
        ("open@when=speed_kmh>=30+when=speed_kmh<=20", "open@0.3+0.4"),
        ("open@when=speed_kmh>=30+when=speed_kmh<=20,for=0.1", "open@0.3+0.5"),
        ("open@0+when=speed_kmh<=0", "open@0+0.9"),
        ("open@0.4+when=speed_kmh>35", "open@0.4+0.1"),
        ("open@0.4+when=speed_kmh>90", "open@0.4"),
    ],
)
def test_conditions(text, found):
    """A fault begins at the first sample its condition has held for long enough, and ends likewise."""
    lap = lap_of([0, 10, 20, 30, 35, 40, 30, 20, 10, 0])
    assert resolved(text, lap) == found


def test_a_condition_that_breaks_off_starts_again():
    """A condition must hold without a break for as long as asked."""
    lap = lap_of([50, 50, 0, 50, 50, 50, 0])
    assert resolved("open@when=speed_kmh>40,for=0.2", lap) == "open@0.5"
    with pytest.raises(FaultError, match="never comes true"):
        resolved("open@when=speed_kmh>40,for=0.3", lap)


def test_times_are_from_the_laps_start():
    """A lap whose clock does not start at zero gives the same instants."""
    lap = lap_of([0, 10, 20, 30], start_ns=77 * MS)
    assert resolved("open@when=speed_kmh>15", lap) == "open@0.2"
    assert resolved("open@sector=1/2", lap) == "open@0"


@pytest.mark.parametrize(("sector", "found"), [("1/4", "0"), ("2/4", "2"), ("3/4", "3"), ("4/4", "4")])
def test_sectors_are_of_equal_distance(sector, found):
    """Ridden half as fast, the first half of the way takes longer: the sectors are not of equal time."""
    # 2 s at 36 km/h, then 72: 60 m in 5 s but for the step between
    lap = lap_of([36] * 21 + [72] * 40)
    assert float(resolved(f"open@sector={sector}", lap).removeprefix("open@")) == pytest.approx(
        float(found), abs=0.8
    )


@given(st.lists(st.floats(0, 300), min_size=2, max_size=50), st.integers(1, 12))
def test_sectors_follow_each_other(speeds, of):
    """Sector 1 begins with the lap, the others in order, each with its share of the way behind."""
    lap = lap_of([*speeds, 1.0])
    begins = [resolve(parse_fault(f"speed:open@sector={k}/{of}"), lap).t_cmd_ns for k in range(1, of + 1)]
    assert begins[0] == 0
    assert begins == sorted(begins)
    v = lap.channels["speed_kmh"]
    way = np.concatenate(([0.0], np.cumsum((v[1:] + v[:-1]) / 2)))
    for k, t_ns in enumerate(begins):
        sample = int(np.searchsorted(lap.t_ns, t_ns))
        assert way[sample] >= k / of * way[-1] * (1 - 1e-12)
        assert sample == 0 or way[sample - 1] <= k / of * way[-1] * (1 + 1e-12)


def test_sectors_of_time_without_speed():
    """A lap without a speed is cut into equal times."""
    lap = Lap(np.arange(9) * 100 * MS, {"rear_stroke_mm": np.zeros(9)})
    assert resolve(parse_fault("rear_stroke:open@sector=3/4"), lap).t_cmd_ns == 400 * MS


@given(st.integers(0, 10**9), st.integers(1, 10**9), st.integers(0, 2**32 - 1))
def test_chance_stays_in_its_window(low, more, seed):
    """An instant drawn lies in the window, and is the same whenever it is drawn, on whatever lap."""
    text = f"speed:open@random={low / 1e9:.9f}..{(low + more) / 1e9:.9f},seed={seed}"
    spec = parse_fault(text)
    found = resolve(spec, lap_of([1, 2])).t_cmd_ns
    assert low <= found < low + more
    assert resolve(spec, lap_of([3, 4, 5])).t_cmd_ns == found


def test_chance_differs():
    """Another seed, and another fault of the same seed, come at another instant."""
    lap = lap_of([1, 2])
    texts = ("speed:open@random=0..9", "speed:open@random=0..9,seed=1", "speed:hold@random=0..9")
    assert len({resolve(parse_fault(text), lap).t_cmd_ns for text in texts}) == 3


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (
            "open@when=speed_kmh>400",
            "speed:open@when=speed_kmh>400: never comes true in this lap, whose speed_kmh is 0 to 0",
        ),
        ("open@when=pitch_rate_dps>4", "the lap lacks pitch_rate_dps; it has speed_kmh"),
        ("open@0+when=pitch_rate_dps>4", "the lap lacks pitch_rate_dps"),
        ("open@sector=2/3", "the motorcycle stands all the lap, it has no sectors"),
    ],
)
def test_refused(text, says):
    """A start that never comes, a channel the lap lacks, and sectors of no way are refused by name."""
    with pytest.raises(FaultError, match=re.escape(says)):
        resolve(parse_fault(f"speed:{text}"), lap_of([0, 0, 0]))
