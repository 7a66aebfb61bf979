"""The circuit between a stroke potentiometer and the logger's converter, solved: slider ratio to pin voltage.

Belongs here: the resistors, the Thevenin equivalents, and both ways through the healthy circuit. Never: a
fault's name, a stroke in millimetres.

Voltages are shares of the converter's reference, which is the potentiometers' supply. The track is fed
through the supply's and the ground's wire, its slider goes through the signal's wire to the pin, where a pull
resistor and whatever leaks there are connected:

    1 --supply_ohm--+--(1-x) track--+--x track--+--ground_ohm-- ground
                                    |
                               signal_ohm
                                    +-- pin --+--pull_ohm-- pull_to
                                              +--leak_ohm-- leak_to

FIDELITY: resistors only. The pin draws no current, its clamps are ideal (the code saturates), the supply
holds whatever is shorted to it, no capacitor smooths a contact that opens.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.sensors.transducers import REFERENCE_V

Floats = NDArray[np.float64]

TRACK_OHM = 5_000.0
"""Assumed: hybrid tracks of 100 to 150 mm have some kiloohms; the SLS130's sheet could not be found."""

PULL_OHM = 1_000_000.0
"""Assumed: two hundred tracks, so that it moves a healthy pin by 0.13 % of the range at most."""

BATTERY = 12.0 / REFERENCE_V
"""A motorcycle's battery, as a share of the reference."""


@dataclass(frozen=True)
class Network:
    """Resistors in ohm, voltages as shares of the reference; the defaults are the healthy circuit."""

    track_ohm: float = TRACK_OHM
    supply_ohm: float = 0.0
    ground_ohm: float = 0.0
    signal_ohm: float = 0.0
    pull_ohm: float = PULL_OHM
    pull_to: float = 1.0
    leak_ohm: float = math.inf
    leak_to: float = 0.0
    ground: float = 0.0

    def wiper(self, x: Floats) -> tuple[Floats, Floats]:
        """Thevenin voltage and resistance at the slider, float64 (samples,), at slider ratios `x` (0..1)."""
        above = (1.0 - x) * self.track_ohm + self.supply_ohm
        below = x * self.track_ohm + self.ground_ohm
        total = self.track_ohm + self.supply_ohm + self.ground_ohm
        return (below + above * self.ground) / total, above * below / total

    def source(self, x: Floats) -> tuple[Floats, Floats]:
        """Thevenin voltage and resistance at the pin, float64 (samples,), without what leaks there."""
        if math.isinf(self.signal_ohm):
            return np.full_like(x, self.pull_to), np.full_like(x, self.pull_ohm)
        v, ohm = self.wiper(x)
        return joined(v, ohm + self.signal_ohm, self.pull_to, self.pull_ohm)

    def pin(self, x: Floats) -> Floats:
        """Voltage at the converter's pin, float64 (samples,)."""
        v, ohm = self.source(x)
        return joined(v, ohm, self.leak_to, self.leak_ohm)[0]

    def slider(self, v: Floats) -> Floats:
        """Slider ratios float64 (samples,) at which the pin has `v`, wires and leaks aside.

        v (track x (1-x) + pull) = x pull + pull_to track x (1-x), a quadratic in x.
        """
        drop = v - self.pull_to
        a, b, c = -drop * self.track_ohm, drop * self.track_ohm - self.pull_ohm, v * self.pull_ohm
        # the root that lies in 0..1, in the form that loses no digits where a is small
        return np.clip(2.0 * c / (np.sqrt(b * b - 4.0 * a * c) - b), 0.0, 1.0)


def joined(
    v: Floats, ohm: Floats, other_v: Floats | float, other_ohm: Floats | float
) -> tuple[Floats, Floats]:
    """Two Thevenin sources on one node: its voltage and resistance. Infinite ohms are no source.

    A source of zero ohms wins; of two such the second, as the short that comes to a circuit.
    """
    if np.ndim(other_ohm) == 0 and math.isinf(float(other_ohm)):
        return v, ohm
    total = ohm + other_ohm
    dead = total == 0.0
    total = np.where(dead, 1.0, total)
    node = np.where(dead, other_v, (v * other_ohm + other_v * ohm) / total)
    return node, np.where(dead, 0.0, ohm * other_ohm / total)
