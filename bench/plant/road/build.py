"""The road laid: stretches one after the other, drawn from a seed, on gentle hills.

Belongs here: what follows what, and from which random stream. Never: time, speed or the motorcycle.

FIDELITY: one track, straight: both wheels run in it, and nothing banks.
"""

import numpy as np
from numpy.typing import NDArray

from bench.plant.road.envelope import envelope
from bench.plant.road.grid import STEP_M, Road
from bench.plant.road.obstacles import put
from bench.plant.road.stretch import Stretch
from bench.plant.road.surface import SURFACES, lay

LEAD_IN_M = 4.0  # flat, so that both wheels start at rest on it
RUN_OUT_M = 4.0
GRADE_KNOT_M = 150.0
GRADE_SIGMA = 0.012  # rise per run: gentle country
ROUGHNESS_SPREAD = 0.15  # one stretch of a class against another, relative, of the amplitude


def build_road(stretches: tuple[Stretch, ...], seeds: np.random.SeedSequence) -> Road:
    """Draw a road. The same seeds and the same first stretches give the same first metres.

    Every stretch has a random stream of its own and begins at the level at which the one before it ended.
    """
    hills, *streams = seeds.spawn(1 + len(stretches))
    bounds = np.cumsum([0.0] + [stretch.length_m for stretch in stretches])
    edges = np.floor(bounds / STEP_M + 0.5).astype(np.int64)
    count = int(edges[-1]) + round(RUN_OUT_M / STEP_M)
    height = np.zeros(count)
    level = 0.0
    for k, stretch in enumerate(stretches):
        here, end = _heights(stretch, int(edges[k + 1] - edges[k]), streams[k])
        height[edges[k] : edges[k + 1]] = level + here
        level += end
    height[edges[-1] :] = level
    graded = np.random.Generator(np.random.PCG64(hills))
    knots = graded.standard_normal(int(count * STEP_M / GRADE_KNOT_M) + 2) * GRADE_SIGMA
    knots[0] = 0.0
    grade = np.interp(np.arange(count) * STEP_M, np.arange(len(knots)) * GRADE_KNOT_M, knots)
    height += np.cumsum(grade * STEP_M)
    flat = np.zeros(round(LEAD_IN_M / STEP_M))
    return Road(envelope(np.concatenate([flat, height])), np.concatenate([flat, grade]))


def _heights(stretch: Stretch, count: int, seed: np.random.SeedSequence) -> tuple[NDArray[np.float64], float]:
    """Heights of one stretch over the level at which it begins, and that at which the next one does."""
    spread, rough, scattered = seed.spawn(3)
    end = 0.0
    if stretch.profile is not None:
        whole = stretch.profile.filled(count + 1)
        height, end = whole[:-1].copy(), float(whole[-1])
    else:
        assert stretch.surface is not None  # a stretch has the one or the other
        factor = 1.0 + ROUGHNESS_SPREAD * np.random.Generator(np.random.PCG64(spread)).uniform(-1.0, 1.0)
        height = lay(SURFACES[stretch.surface], count, factor, rough)
    rng = np.random.Generator(np.random.PCG64(scattered))
    for obstacle in stretch.obstacles:
        end += put(obstacle, height, rng)
    return height, end
