import pickle

import numpy as np
import pytest

from bench.errors import LapError
from bench.laps import Lap

T_NS = np.array([0, 1_000_000, 2_000_000])
FORK = np.array([50.0, 51.0, 52.0])


def test_arrays_are_read_only():
    """Nothing can write into a lap's time base or channels."""
    lap = Lap(T_NS, {"fork_stroke_mm": FORK})
    with pytest.raises(ValueError, match="read-only"):
        lap.channels["fork_stroke_mm"][0] = 0.0
    with pytest.raises(ValueError, match="read-only"):
        lap.t_ns[0] = 1


def test_arrays_are_copied():
    """Writing into the arrays a lap was made of leaves the lap as it was."""
    fork = FORK.copy()
    lap = Lap(T_NS, {"fork_stroke_mm": fork})
    fork[0] = -1.0
    assert lap.channels["fork_stroke_mm"][0] == 50.0


def test_equality_ignores_the_source():
    """Two laps with the same samples are equal and hash alike, wherever they came from."""
    one, other = (Lap(T_NS, {"fork_stroke_mm": FORK}, source) for source in ("a.csv", "b.csv"))
    assert one == other
    assert hash(one) == hash(other)


def test_one_value_makes_a_different_lap():
    """A lap that differs in a single value is not equal."""
    other = FORK + np.array([0, 0, 1e-12])
    assert Lap(T_NS, {"fork_stroke_mm": FORK}) != Lap(T_NS, {"fork_stroke_mm": other})


def test_channel_order_is_fixed():
    """Channels come in the order of CHANNELS, whatever order they were given in."""
    lap = Lap(T_NS, {"speed_kmh": FORK, "fork_stroke_mm": FORK})
    assert list(lap.channels) == ["fork_stroke_mm", "speed_kmh"]


def test_survives_pickling():
    """A lap sent to a worker process arrives equal."""
    lap = Lap(T_NS, {"fork_stroke_mm": FORK}, "a.csv")
    assert pickle.loads(pickle.dumps(lap)) == lap


def test_require_names_what_is_missing_and_who_needs_it():
    """Asking for a channel the lap lacks names the channel, the lap and the asker."""
    with pytest.raises(LapError, match=r"a\.csv: missing rear_stroke_mm, needed by the IFD"):
        Lap(T_NS, {"fork_stroke_mm": FORK}, "a.csv").require(["fork_stroke_mm", "rear_stroke_mm"], "the IFD")


@pytest.mark.parametrize(
    ("t_ns", "channels", "says"),
    [
        ([0], {"fork_stroke_mm": [1.0]}, "1 samples"),
        ([0, 0], {"fork_stroke_mm": [1.0, 2.0]}, "does not increase at sample 1: 0 s then 0 s"),
        ([-1, 0], {"fork_stroke_mm": [1.0, 2.0]}, "negative time: it starts at -1e-09 s"),
        ([0, 1], {"fork_stroke_mm": [1.0]}, "fork_stroke_mm has 1 samples, the time base 2"),
        ([0, 1], {"fork_stroke_mm": [1.0, np.nan]}, "fork_stroke_mm is nan at sample 1"),
        ([0, 1], {"roll_dps": [1.0, 2.0]}, "unknown channel roll_dps"),
        ([0, 1], {}, "no channel"),
    ],
)
def test_refuses_what_is_no_lap(t_ns, channels, says):
    """A lap that is too short, goes back in time or is not complete is refused with the value at fault."""
    with pytest.raises(LapError, match=says):
        Lap(np.array(t_ns), {name: np.array(values) for name, values in channels.items()})
