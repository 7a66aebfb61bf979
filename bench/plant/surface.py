"""Road surfaces as data: how rough each is, in the terms of ISO 8608.

FIDELITY: the thesis describes its roads in words only; these numbers are assumed from the ISO classes.
"""

from typing import NamedTuple


class Surface(NamedTuple):
    """Displacement spectrum G(n) = roughness_m3 (n / 0.1)^-2 over spatial frequency n, plus stones if any."""

    roughness_m3: float  # G at 0.1 cycles/m (ISO 8608: class A 16e-6, B 64e-6, C 256e-6, D 1024e-6)
    stone_m: float = 0.0  # standard deviation of one stone's height
    stone_pitch_m: float = 0.12  # stone to stone


SURFACES = {
    "smooth": Surface(12e-6),  # new asphalt, class A
    "extra_urban": Surface(32e-6),  # between A and B
    "urban": Surface(64e-6),  # class B
    "rough_urban": Surface(200e-6),  # patched town road, towards class C
    "cobblestone": Surface(400e-6, stone_m=0.004),  # between C and D, and the stones
}
