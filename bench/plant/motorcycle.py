"""The motorcycle as numbers: masses, geometry, struts and tyres, read from TOML and checked.

Belongs here: what the parameters are and which values are physical. Never: an equation of motion.
The records are named tuples because compiled kernels take those as they are.
"""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from bench.errors import RouteError
from bench.toml import read_table

FOLDER = Path(__file__).parent / "motorcycles"
NAMES = ("gsxr1000", "gsxr1000_magneto", "naked700", "sport_tourer")
"""Motorcycles that come with the bench."""

DEFAULT = NAMES[0]
MOST_LOAD_KG = 250.0
"""Of luggage and a pillion: what a frame is approved for."""
LEAST_A, MOST_A = 0.1, 2.0
"""Current in the coil of a magnetorheological damper, in amperes (section I.4)."""


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
    air_exponent: float  # polytropic: 1 isothermal, 1.4 adiabatic
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
    mr_full_n: float = 0.0  # yield force of a magnetorheological damper at 2 A; zero: conventional
    mr_half_a: float = 1.0  # current at which saturation has halved what an ampere adds per ampere at zero
    mr_knee_m_per_s: float = 0.05  # element speed at which half of the yield force acts


class Tyre(NamedTuple):
    """A tyre pushes, never pulls; its damping grows with its deflection: contact begins without a blow."""

    stiffness_n_per_m: float
    damping_s_per_m: float  # damping force per deflection force and deflection speed
    fastest_kmh: float  # its speed rating: the model says nothing beyond


class Magneto(NamedTuple):
    """The controller of magnetorheological dampers (section I.5): sky-hook, as far as a current can."""

    sky_front_ns_per_m: float = (
        0.0  # force wanted per speed of the body over the front wheel; zero: 0.1 A always
    )
    sky_rear_ns_per_m: float = 0.0
    lag_s: float = 0.005  # coil and power amplifier, first order


class Motorcycle(NamedTuple):
    """Half-car model with rider (section II.4): a sprung body, two wheels and the rider, all in one plane."""

    sprung_kg: float  # frame, engine and what of the rider moves with them
    pitch_inertia_kgm2: float
    front_kg: float  # what moves with the front wheel
    rear_kg: float
    to_front_m: float  # centre of gravity to front axle, horizontally
    to_rear_m: float
    height_m: float  # centre of gravity of everything above the road
    rider_kg: float  # the rider's upper body, on a spring and a damper of its own
    rider_behind_m: float  # behind the centre of gravity
    rider_hz: float  # its natural frequency on a seat that does not move ...
    rider_damping: float  # ... and damping ratio
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
    magneto: Magneto = Magneto()

    @property
    def wheelbase_m(self) -> float:
        """Axle to axle."""
        return self.to_front_m + self.to_rear_m

    @property
    def mass_kg(self) -> float:
        """Everything, rider included."""
        return self.sprung_kg + self.rider_kg + self.front_kg + self.rear_kg


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
    "mr_full_n",
    "sky_front_ns_per_m",
    "sky_rear_ns_per_m",
}
_MAY_BE_NEGATIVE = {"sensor_rise_per_m", "body_sensor_m", "rider_behind_m"}
_SECTIONS: dict[str, Any] = {
    "fork": Strut,
    "shock": Strut,
    "front_tyre": Tyre,
    "rear_tyre": Tyre,
    "magneto": Magneto,
}


def load_motorcycle(name: str | Path = DEFAULT) -> Motorcycle:
    """Read and check a motorcycle by its name (see NAMES) or from a TOML file.

    A file may name another as `based_on` and state only what differs. Raises RouteError naming the file, the
    key and the value that is missing, unknown or not physical.
    """
    path = _path(name)
    table = _inherited(path)
    parts: dict[str, Any] = {section: _record(path, section, table.pop(section, {})) for section in _SECTIONS}
    numbers = _numbers(path, "", table, [key for key in Motorcycle._fields if key not in parts], {})
    motorcycle = Motorcycle(**{**parts, **numbers})
    _check(path, motorcycle)
    return motorcycle


def carrying(motorcycle: Motorcycle, load_kg: float) -> Motorcycle:
    """The motorcycle with luggage of so many kg over its rear axle, fixed to the frame.

    FIDELITY: a point at the height of the centre of gravity; no drag of its own. Raises RouteError for a
    load that is none.
    """
    if not 0 <= load_kg <= MOST_LOAD_KG:
        raise RouteError(f"a load of {load_kg:g} kg is not from 0 to {MOST_LOAD_KG:g} kg")
    m, share = motorcycle, load_kg / (motorcycle.sprung_kg + load_kg)
    back_m = share * m.to_rear_m  # by so much the centre of gravity moves
    return m._replace(
        sprung_kg=m.sprung_kg + load_kg,
        # parallel axes: the reduced mass at the distance of the two centres
        pitch_inertia_kgm2=m.pitch_inertia_kgm2 + share * m.sprung_kg * m.to_rear_m**2,
        to_front_m=m.to_front_m + back_m,
        to_rear_m=m.to_rear_m - back_m,
        rider_behind_m=m.rider_behind_m - back_m,
        body_sensor_m=m.body_sensor_m + back_m,
    )


def _path(name: str | Path) -> Path:
    if str(name) in NAMES:
        return FOLDER / f"{name}.toml"
    if Path(name).suffix != ".toml":
        raise RouteError(
            f"unknown motorcycle {str(name)!r}; the known ones are {', '.join(NAMES)}, or a .toml file"
        )
    return Path(name)


def _inherited(path: Path, heirs: tuple[Path, ...] = ()) -> dict[str, Any]:
    """The table of a file, laid over the one it is based on."""
    if path in heirs:
        raise RouteError(f"{path}: is based on itself")
    table = read_table(path, RouteError)
    base = table.pop("based_on", None)
    if base is None:
        return table
    if not isinstance(base, str):
        raise RouteError(f"{path}: based_on is {base!r}, not a motorcycle")
    below = _inherited(_path(base) if base in NAMES else path.parent / base, (*heirs, path))
    for key, value in table.items():
        both = isinstance(value, dict) and isinstance(below.get(key), dict)
        below[key] = {**below[key], **value} if both else value
    return below


def _record(path: Path, name: str, table: Any) -> Any:
    if not isinstance(table, dict):
        raise RouteError(f"{path}: {name} is {table!r}, not a table")
    kind = _SECTIONS[name]
    return kind(**_numbers(path, f"{name}.", table, kind._fields, kind._field_defaults))


def _numbers(
    path: Path, prefix: str, table: dict[str, Any], names: Sequence[str], defaults: dict[str, float]
) -> dict[str, float]:
    for key in table:
        if key not in names:
            raise RouteError(f"{path}: unknown key {prefix}{key}")
    values = {}
    for name in names:
        if name not in table:
            if name in defaults:
                continue
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
