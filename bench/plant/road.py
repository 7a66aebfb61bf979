"""The road profile: height and grade along the route, drawn at random from a seed.

Belongs here: geometry of the ground in metres. Never: time, speed or the motorcycle.

FIDELITY: one track, straight; the tyre envelops by averaging over its contact length, so that it reaches into
holes it would bridge.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.plant.route import Stretch
from bench.plant.surface import SURFACES
from targets.jit import njit

STEP_M = 0.02  # a fifth of a tyre's contact length
LEAD_IN_M = 4.0  # flat, so that both wheels start at rest on it
RUN_OUT_M = 4.0
LONGEST_WAVE_M = 100.0  # ISO 8608 speaks of 0.011 cycles/m and above; longer waves are the grade
CONTACT_M = 0.08  # averaged over twice: a tyre envelops what is shorter than its contact patch
GRADE_KNOT_M = 150.0
GRADE_SIGMA = 0.012  # rise per run: gentle country
ROUGHNESS_SPREAD = 0.15  # one stretch of a class against another, relative, of the amplitude


class Road(NamedTuple):
    """Heights and grades every STEP_M from where the rear wheel starts; the route begins LEAD_IN_M later."""

    height_m: NDArray[np.float64]
    grade: NDArray[np.float64]

    def grade_at(self, x_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Rise per run at places in metres from where the rear wheel starts."""
        return np.interp(x_m / STEP_M, np.arange(len(self.grade)), self.grade)


def build_road(stretches: tuple[Stretch, ...], seeds: np.random.SeedSequence) -> Road:
    """Draw a road. The same seeds and the same first stretches give the same first metres."""
    rough, stony, graded, spread = (np.random.Generator(np.random.PCG64(s)) for s in seeds.spawn(4))
    lead = round(LEAD_IN_M / STEP_M)
    bounds = np.cumsum([0.0] + [stretch.length_m for stretch in stretches])
    edges = np.floor(bounds / STEP_M + 0.5).astype(np.int64)
    count = int(edges[-1]) + round(RUN_OUT_M / STEP_M)
    amplitude, stones = np.zeros(count), np.zeros(count)
    bumps = np.zeros(count)
    for k, stretch in enumerate(stretches):
        surface = SURFACES[stretch.surface]
        here = slice(edges[k], edges[k + 1])
        factor = 1.0 + ROUGHNESS_SPREAD * spread.uniform(-1.0, 1.0)
        # White slope of one-sided density S = (2 pi 0.1)^2 G(0.1) has the variance S / (2 dx) per sample.
        amplitude[here] = factor * np.sqrt((0.2 * np.pi) ** 2 * surface.roughness_m3 / (2.0 * STEP_M))
        if surface.stone_m:
            at = np.arange(edges[k], edges[k + 1]) * (STEP_M / surface.stone_pitch_m)
            # Cut at 2.5 sigma: higher stones have been driven flat.
            heights = np.clip(stony.standard_normal(int(at[-1] - at[0]) + 3), -2.5, 2.5)
            stones[here] = factor * surface.stone_m * np.interp(at - at[0], np.arange(len(heights)), heights)
        for bump in range(stretch.bumps):
            _add_bump(bumps, bounds[k] + stretch.bump_lead_m + bump * stretch.bump_spacing_m, stretch)
    slope = amplitude * rough.standard_normal(count)
    knots = graded.standard_normal(int(count * STEP_M / GRADE_KNOT_M) + 2) * GRADE_SIGMA
    knots[0] = 0.0
    grade = np.interp(np.arange(count) * STEP_M, np.arange(len(knots)) * GRADE_KNOT_M, knots)
    height = _leaky_sum(slope * STEP_M, 2.0 * np.pi * STEP_M / LONGEST_WAVE_M)
    height += stones + bumps + np.cumsum(grade * STEP_M)
    flat = np.zeros(lead)
    return Road(_envelope(np.concatenate([flat, height])), np.concatenate([flat, grade]))


def _add_bump(heights: NDArray[np.float64], start_m: float, stretch: Stretch) -> None:
    """Lay a rounded bump, h (1 - u^2)^2 with u from -1 to 1 over its length."""
    first = round(start_m / STEP_M)
    count = round(stretch.bump_length_m / STEP_M)
    u = np.linspace(-1.0, 1.0, count + 1)
    room = heights[first : first + count + 1]
    room += stretch.bump_height_m * ((1.0 - u * u) ** 2)[: len(room)]


@njit(cache=True)
def _leaky_sum(steps: Any, leak: float) -> Any:
    """Sum that forgets at the rate `leak` per sample: slope to height without the longest waves."""
    out = np.empty_like(steps)
    total = 0.0
    for k in range(len(steps)):
        total += steps[k] - leak * total
        out[k] = total
    return out


def _envelope(height: NDArray[np.float64]) -> NDArray[np.float64]:
    """What the wheel's centre follows: the moving average over the contact length, taken twice, centred."""
    width = round(CONTACT_M / STEP_M)
    for _ in range(2):
        total = np.cumsum(np.concatenate([np.zeros(1), height, np.full(width, height[-1])]))
        height = (total[width:] - total[:-width])[: len(height)] / width
    # Each pass looks (width - 1) / 2 samples ahead: shift back by both together.
    return np.concatenate([np.full(width - 1, height[0]), height[: len(height) - width + 1]])
