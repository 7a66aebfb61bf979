"""The sensors of Table II.1, each with the path from a physical value to the integer code it gives.

Belongs here: one row per sensor, and the conversion both ways. Never: a lap, a fault, a CAN layout.
One rounding rule for all of them: half to even, then saturation at the code range. A code beyond the
sensor's span never leaves this file, so nothing downstream can overflow.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bench.errors import LapError

SUPPLY_V = 5.0
"""Supply of the potentiometers. FIDELITY: it is also the ADC's reference, so that its value cancels."""

REFERENCE_V = SUPPLY_V


@dataclass(frozen=True)
class Transducer:
    """One sensor with its converter; physical values are in the unit that ends `channel`.

    low, high: the span, physical. code_min, code_max: the codes of its two ends, the full scale of a fault.
    per_code: physical value of one code, equal to the scale of the CAN signal named `channel`.
    tolerance_codes: a healthy sensor stays this close to its true code; `tolerance` says where that is from.
    ratiometric: a potentiometer read against its own supply, instead of a sensor that counts by itself.
    """

    sensor: str
    channel: str
    model: str
    low: float
    high: float
    code_min: int
    code_max: int
    per_code: float
    tolerance_codes: int
    tolerance: str
    ratiometric: bool = False

    def to_codes(self, values: ArrayLike) -> tuple[NDArray[np.int32], int]:
        """Codes int32 of physical `values`, same shape, and how many of them saturated.

        Raises LapError for NaN, which has no code.
        """
        values = np.asarray(values, dtype=np.float64)
        if np.isnan(values).any():
            raise LapError(f"channel {self.channel} is nan: the {self.model} has no code for it")
        return self.saturate(self.exact(values))

    def exact(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Codes of physical `values` before rounding and saturation, float64, same shape."""
        if not self.ratiometric:
            return values / self.per_code
        # slider ratio, wiper voltage, counts of the converter; in place: fresh memory costs more than sums
        exact = np.asarray(values - self.low)
        exact /= self.high - self.low
        exact *= SUPPLY_V
        exact /= REFERENCE_V
        exact *= self.code_max - self.code_min
        exact += self.code_min
        return exact

    def saturate(self, exact: NDArray[np.float64]) -> tuple[NDArray[np.int32], int]:
        """Round codes given as float64 half to even into int32 within the range; and how many left it."""
        codes = np.rint(exact)
        within = np.clip(codes, self.code_min, self.code_max)
        return within.astype(np.int32), int(np.count_nonzero(within != codes))

    def to_physical(self, codes: ArrayLike) -> NDArray[np.float64]:
        """Physical float64 values of `codes`, same shape: what a receiver of the CAN signal computes."""
        return np.asarray(codes, dtype=np.float64) * self.per_code


_LINEARITY = "0.25 % of the stroke, independent linearity (assumed; the data sheet's depends on the stroke)"
_NONLINEARITY = "0.2 % of full scale, non-linearity; the zero-rate level is taken as calibrated away"
_ENCODER = "0.5 km/h (assumed: no public data sheet)"
_ZERO_G = "70 mg, typical zero-g level offset (data sheet, table 3)"


def _accelerometer(place: str) -> Transducer:
    return Transducer(
        sensor=f"acc_{place}",
        channel=f"acc_{place}_ms2",
        model="LIS331HH",
        low=-235.3596,  # 24 g, standard gravity 9.80665 m/s2
        high=235.3596,
        code_min=-2000,
        code_max=2000,
        per_code=0.1176798,  # 12 mg a digit
        tolerance_codes=6,
        tolerance=_ZERO_G,
    )


_TABLE = (
    Transducer(
        sensor="fork_stroke",
        channel="fork_stroke_mm",
        model="SLS130",
        low=0.0,
        high=150.0,
        code_min=0,
        code_max=4095,
        per_code=0.0366300366300366,  # 150 mm / 4095, to the digits of the DBC
        tolerance_codes=10,
        tolerance=_LINEARITY,
        ratiometric=True,
    ),
    Transducer(
        sensor="rear_stroke",
        channel="rear_stroke_mm",
        model="SLS130",
        low=0.0,
        high=110.0,
        code_min=0,
        code_max=4095,
        per_code=0.0268620268620269,  # 110 mm / 4095, to the digits of the DBC
        tolerance_codes=10,
        tolerance=_LINEARITY,
        ratiometric=True,
    ),
    Transducer(
        sensor="pitch_rate",
        channel="pitch_rate_dps",
        model="L3GD20",
        low=-250.0,
        high=250.0,
        code_min=-28571,  # FIDELITY: the register's headroom past the full scale is not modelled
        code_max=28571,
        per_code=0.00875,  # 8.75 mdps a digit
        tolerance_codes=57,
        tolerance=_NONLINEARITY,
    ),
    Transducer(
        sensor="speed",
        channel="speed_kmh",
        model="970-011",
        low=0.0,
        high=300.0,
        code_min=0,
        code_max=30000,
        per_code=0.01,  # the logger's speed code
        tolerance_codes=50,
        tolerance=_ENCODER,
    ),
    _accelerometer("front"),
    _accelerometer("rear"),
    _accelerometer("body"),
)

TRANSDUCERS: dict[str, Transducer] = {row.sensor: row for row in _TABLE}
"""Table II.1 (which lacks the body's accelerometer; section II.5 has it): sensor name -> Transducer."""

BY_CHANNEL: dict[str, Transducer] = {row.channel: row for row in _TABLE}
"""The same rows by the lap channel that each sensor measures."""
