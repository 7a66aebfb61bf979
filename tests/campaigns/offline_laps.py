"""A network and laps it predicts well, but not always, for the tests of the offline campaign."""

import numpy as np

from bench.laps.lap import Lap
from bench.mdlog.logger import sampled
from bench.sensors.codes import acquire
from campaigns.offline_plan import OfflineCampaign
from targets.narx.network import Narx
from tests.conftest import network, wavy_lap

NARX = network()


def followed_lap(seed: int, seconds: float = 20.0, narx: Narx = NARX, percent: float = 7.0) -> Lap:
    """A lap whose rear stroke is what `narx` predicts of it, but for an error that swings by some percent."""
    lap = wavy_lap(seconds, seed=seed)
    seen = sampled(acquire(lap))
    predicted = narx.free_run(np.stack([seen[name] for name in narx.inputs], axis=1))
    rng = np.random.default_rng(seed)
    t_s = lap.t_ns / 1e9
    swings = sum(
        np.sin(w * t_s + p) for w, p in zip(rng.uniform(1, 60, 4), rng.uniform(0, 6, 4), strict=True)
    )
    error = percent / 200 * swings + 0.01 * rng.normal(size=len(t_s))
    stroke = np.repeat(predicted, 10)[: len(t_s)] * (1.0 + error)
    return Lap(lap.t_ns, {**lap.channels, "rear_stroke_mm": stroke}, f"lap {seed}")


FAULTS = {
    "uncalibration": "rear_stroke:uncalibration:gain=1.1",
    "open": "rear_stroke:open",
    "short": "rear_stroke:short",
    "hold": "rear_stroke:hold",
    "fork": "fork_stroke:hold",
}


def plan(**changes) -> OfflineCampaign:
    """A campaign of a few faults with ideal sensors."""
    values = {
        "kind": "offline",
        "title": "t",
        "stands_for": "s",
        "test": {"route": "test_lap", "count": 1, "seed": 30_000},
        "sensors": "ideal",
        "seed": 7,
        "faults": FAULTS,
        "faults_per_kind": 12,
        "L_ms": [10, 50, 200],
        "n": [1, 2, 5],
        "T_percent": [8, 10],
        "t_max_s": 4,
    }
    return OfflineCampaign(**{**values, **changes})
