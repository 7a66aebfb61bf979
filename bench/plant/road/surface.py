"""Road surfaces as data: how rough each is, in the terms of ISO 8608, and the stones it is laid of.

Belongs here: the table, and a piece of road drawn from a row. Never: bumps, holes and measured roads.

FIDELITY: the thesis and the paper on virtual sensors describe their roads in words only; the numbers of the
named surfaces are assumed from the ISO classes.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.plant.road.grid import STEP_M
from bench.plant.road.iso8608 import LEVELS_M3, WAVINESS, synthesise

_HIGHEST_STONE = 2.5  # standard deviations: higher ones have been driven flat


class Surface(NamedTuple):
    """Displacement spectrum G(n) = roughness_m3 (n / 0.1)^-waviness over cycles/m, and the stones."""

    roughness_m3: float  # G at 0.1 cycles/m
    waviness: float = WAVINESS
    stone_m: float = 0.0  # standard deviation of one stone's height
    stone_pitch_m: float = 0.12  # stone to stone


SURFACES = {
    "smooth": Surface(12e-6),  # new asphalt, class A
    "extra_urban": Surface(32e-6),  # between A and B
    "urban": Surface(64e-6),  # class B
    "rough_urban": Surface(200e-6),  # patched town road, towards class C
    "cobblestone": Surface(400e-6, stone_m=0.004),  # between C and D, and the stones
    "motorway": Surface(8e-6),  # the smooth end of class A
    "random": Surface(128e-6),  # between B and C
    "pave": Surface(128e-6, stone_m=0.0025, stone_pitch_m=0.10),  # small setts, well laid
    **{f"iso_{letter.lower()}": Surface(level) for letter, level in LEVELS_M3.items()},
}
"""Surfaces by name. E to H are off-road: the spectrum is right, but no road motorcycle rides them."""


def lay(surface: Surface, count: int, factor: float, seed: np.random.SeedSequence) -> NDArray[np.float64]:
    """Draw `count` heights in metres, STEP_M apart, of a surface `factor` times as rough in amplitude.

    The first height is zero, and so is the one after the last.
    """
    rough, stony = (np.random.Generator(np.random.PCG64(s)) for s in seed.spawn(2))
    height = synthesise(surface.roughness_m3, surface.waviness, count, STEP_M, rough)
    if surface.stone_m:
        # A whole number of stones, the last of them worn down to the next stretch's level.
        stones = max(1, round(count * STEP_M / surface.stone_pitch_m))
        tops = np.clip(stony.standard_normal(stones + 1), -_HIGHEST_STONE, _HIGHEST_STONE)
        tops[0] = tops[-1] = 0.0
        height += surface.stone_m * np.interp(
            np.arange(count) * (stones / count), np.arange(stones + 1), tops
        )
    return factor * height
