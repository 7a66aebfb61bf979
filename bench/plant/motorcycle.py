"""The motorcycle as numbers: masses, geometry, struts and tyres, read from TOML and checked.

Belongs here: what the parameters are and which values are physical. Never: an equation of motion.
The records are named tuples because compiled kernels take those as they are.
"""

import math
from pathlib import Path
from typing import Any, NamedTuple

from bench.errors import RouteError
from bench.toml import read_table

DEFAULT = Path(__file__).with_name("gsxr1000.toml")


class Strut(NamedTuple):
    """One suspension end. Its element (fork leg or shock) moves `linkage` times as far as the wheel."""

    linkage: float  # element travel per vertical wheel travel, fully extended
    linkage_rise_per_m: float  # growth of that ratio with wheel travel
    sensor: float  # sensor stroke per vertical wheel travel, fully extended
    sensor_rise_per_m: float  # growth of that ratio with wheel travel
    sensor_range_mm: float  # full scale of the stroke sensor
    preload_n: float  # spring force, fully extended
    spring_n_per_m: float
    air_n: float  # atmospheric pressure times piston area; zero without an air spring
    air_length_m: float  # air column, fully extended
    compression_ns_per_m: float  # damping at rest ...
    compression_fast_ns_per_m: float  # ... and far above the knee
    rebound_ns_per_m: float
    rebound_fast_ns_per_m: float
    knee_m_per_s: float  # element speed at which half the difference is gone
    friction_n: float  # seal friction, saturating
    friction_m_per_s: float  # element speed at which half of it acts
    bump_m: float  # element travel at which the bump stop is met
    bump_n_per_m2: float  # its force over the square of its compression
    topout_m: float  # element travel below which the top-out spring is met
    topout_n_per_m2: float


class Tyre(NamedTuple):
    """A tyre pushes, never pulls; its damping grows with its deflection: contact begins without a blow."""

    stiffness_n_per_m: float
    damping_s_per_m: float  # damping force per deflection force and deflection speed


class Motorcycle(NamedTuple):
    """Half-car model with rider (section II.4): one sprung body, two wheels, all in the plane of symmetry."""

    sprung_kg: float  # frame, engine, rider
    pitch_inertia_kgm2: float
    front_kg: float  # what moves with the front wheel
    rear_kg: float
    to_front_m: float  # centre of gravity to front axle, horizontally
    to_rear_m: float
    height_m: float  # centre of gravity above the road
    drag_n_per_m2s2: float  # drag force over speed squared
    drag_height_m: float  # where it acts
    front_brake_share: float  # of all retarding force at the ground
    dive_ratio: float  # vertical force taken off the fork's spring path per front braking force
    squat_ratio: float  # vertical force added by chain and swingarm per driving force
    body_sensor_m: float  # body accelerometer ahead of the centre of gravity
    fork: Strut
    shock: Strut
    front_tyre: Tyre
    rear_tyre: Tyre

    @property
    def wheelbase_m(self) -> float:
        """Axle to axle."""
        return self.to_front_m + self.to_rear_m

    @property
    def mass_kg(self) -> float:
        """Everything, rider included."""
        return self.sprung_kg + self.front_kg + self.rear_kg


_MAY_BE_ZERO = {
    "linkage_rise_per_m",
    "preload_n",
    "air_n",
    "friction_n",
    "damping_s_per_m",
    "drag_n_per_m2s2",
    "front_brake_share",
    "dive_ratio",
    "squat_ratio",
}
_MAY_BE_NEGATIVE = {"sensor_rise_per_m", "body_sensor_m"}
_SECTIONS: dict[str, Any] = {"fork": Strut, "shock": Strut, "front_tyre": Tyre, "rear_tyre": Tyre}


def load_motorcycle(path: Path = DEFAULT) -> Motorcycle:
    """Read and check a motorcycle from TOML.

    Raises RouteError naming the file, the key and the value that is missing, unknown or not physical.
    """
    table = read_table(path, RouteError)
    parts: dict[str, Any] = {name: _record(path, name, table.pop(name, {})) for name in _SECTIONS}
    numbers: dict[str, Any] = _numbers(
        path, "", table, [name for name in Motorcycle._fields if name not in parts]
    )
    motorcycle = Motorcycle(**{**parts, **numbers})
    _check(path, motorcycle)
    return motorcycle


def _record(path: Path, name: str, table: Any) -> Strut | Tyre:
    if not isinstance(table, dict):
        raise RouteError(f"{path}: {name} is {table!r}, not a table")
    kind = _SECTIONS[name]
    record: Strut | Tyre = kind(**_numbers(path, f"{name}.", table, kind._fields))
    return record


def _numbers(path: Path, prefix: str, table: dict[str, Any], names: Any) -> dict[str, float]:
    for key in table:
        if key not in names:
            raise RouteError(f"{path}: unknown key {prefix}{key}")
    values = {}
    for name in names:
        if name not in table:
            raise RouteError(f"{path}: missing {prefix}{name}")
        value = table[name]
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise RouteError(f"{path}: {prefix}{name} is {value!r}, not a finite number")
        if value < 0 and name not in _MAY_BE_NEGATIVE:
            raise RouteError(f"{path}: {prefix}{name} is {value}, below zero")
        if value == 0 and name not in _MAY_BE_ZERO | _MAY_BE_NEGATIVE:
            raise RouteError(f"{path}: {prefix}{name} is 0; it must be above")
        values[name] = float(value)
    return values


def _check(path: Path, motorcycle: Motorcycle) -> None:
    if motorcycle.front_brake_share > 1:
        raise RouteError(f"{path}: front_brake_share is {motorcycle.front_brake_share}, above 1")
    for name, strut in (("fork", motorcycle.fork), ("shock", motorcycle.shock)):
        if strut.topout_m >= strut.bump_m:
            raise RouteError(f"{path}: {name}.topout_m {strut.topout_m} is not below bump_m {strut.bump_m}")
        if strut.air_length_m <= strut.bump_m:
            raise RouteError(f"{path}: {name}.air_length_m {strut.air_length_m} ends before the bump stop")
