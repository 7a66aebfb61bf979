import numpy as np
import pytest

from targets.errors import TrainingError
from targets.narx.sequences import Sequences

NAMES = ("fork_stroke_mm", "speed_kmh")


def run(samples: int = 20) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(samples)
    return rng.uniform(10.0, 50.0, (samples, 2)), rng.uniform(10.0, 50.0, samples)


def spoiled(place: int | tuple[int, int], value: float) -> tuple[np.ndarray, np.ndarray]:
    u, y = run()
    (y if isinstance(place, int) else u)[place] = value
    return u, y


def test_samples():
    """The samples of runs of different length are counted together."""
    assert Sequences(NAMES, "rear_stroke_mm", (run(20), run(30))).samples == 50


@pytest.mark.parametrize(
    ("runs", "says"),
    [
        ((), "no sequence"),
        ((run(), (np.zeros((5, 3)), np.zeros(5))), "sequence 1 has 3 input channels, 2 are named"),
        (((np.zeros(5), np.zeros(5)),), "sequence 0 has 0 input channels"),
        (((run()[0], run()[1][:-1]),), "sequence 0 has 19 samples of rear_stroke_mm, 20 of its inputs"),
        (((np.zeros((0, 2)), np.zeros(0)),), "sequence 0 has 0 samples"),
        ((run(), spoiled((7, 1), np.nan)), "sequence 1: speed_kmh is nan at sample 7"),
        ((spoiled(3, np.inf),), "sequence 0: rear_stroke_mm is inf at sample 3"),
        (
            ((np.stack([np.arange(9.0), np.full(9, 50.0)], axis=1), np.arange(9.0)),),
            "speed_kmh is 50 in every",
        ),
        (((run()[0], np.full(20, 40.0)),), "rear_stroke_mm is 40 in every sample"),
    ],
)
def test_unfit_runs(runs, says):
    """Runs that nothing can be learned from are refused in one line that names them."""
    with pytest.raises(TrainingError) as refusal:
        Sequences(NAMES, "rear_stroke_mm", runs)
    assert says in str(refusal.value)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(("names", "output"), [((), "y"), (("a", "a"), "y"), (("a", "y"), "y")])
def test_unfit_names(names, output):
    """Inputs must be there, differ, and not be the output."""
    with pytest.raises(TrainingError, match="not distinct"):
        Sequences(names, output, (run(),))


def test_unfit_rate():
    """A sampling rate of 0 is refused."""
    with pytest.raises(TrainingError, match="0 Hz"):
        Sequences(NAMES, "rear_stroke_mm", (run(),), rate_hz=0)
