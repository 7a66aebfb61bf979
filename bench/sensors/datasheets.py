"""Sensors from TOML: the data sheets' figures that the bench ships, or a file of the user's.

Belongs here: reading the file and refusing what no part can be. Never: a figure, what a figure does.
What a file leaves out is ideal, so that one imperfection can be looked at alone.
"""

import math
from dataclasses import MISSING, Field, fields
from pathlib import Path
from typing import Any

from bench.errors import SensorError
from bench.sensors.parts import IDEAL, Encoder, Logger, Mems, Potentiometer, Sensors
from bench.toml import read_table

__all__ = ["DATASHEET", "IDEAL", "Sensors", "load_sensors"]

DATASHEET = Path(__file__).with_name("datasheets.toml")

_LOGGER = "logger"
_KINDS: dict[str, Any] = {
    "SLS130": Potentiometer,
    "L3GD20": Mems,
    "LIS331HH": Mems,
    "970-011": Encoder,
    _LOGGER: Logger,
}
_ABOVE_ZERO = {"unit", "grain_mm", "warming_s", "teeth", "circumference_m", "tick_s", "timeout_s"}
_AT_MOST = {
    "linearity": 0.5,
    "smoothness": 0.5,
    "nonlinearity": 0.5,
    "sensitivity": 0.3,  # three sigma leave the slope positive
    "circumference": 0.3,
    "edge_error": 0.05,
    "supply_tolerance": 0.5,
    "supply_ripple": 0.4,  # with the tolerance the supply stays above zero
    "reference_follows": 1.0,
    "reference_mismatch": 0.3,
    "lowpass_order": 2,
    "teeth": 1000,
}


def load_sensors(name_or_path: str | Path) -> Sensors:
    """The sensors called "datasheet" or "ideal", or those of a `.toml` file.

    Raises SensorError naming the file, the key and the value that is unknown, missing or not physical.
    """
    if name_or_path == "ideal":
        return IDEAL
    path = DATASHEET if name_or_path == "datasheet" else Path(name_or_path)
    if path.suffix != ".toml":
        raise SensorError(f"sensors {str(name_or_path)!r} are neither datasheet, ideal nor a .toml file")
    parts = {model: _part(path, model, rows) for model, rows in read_table(path, SensorError).items()}
    logger = parts.pop(_LOGGER, None)
    return Sensors("datasheet" if path == DATASHEET else str(path), parts, logger)


def _part(path: Path, model: str, rows: Any) -> Any:
    if model not in _KINDS:
        raise SensorError(f"{path}: unknown part {model}; the known ones are {', '.join(_KINDS)}")
    if not isinstance(rows, dict):
        raise SensorError(f"{path}: {model} is {rows!r}, not a table")
    known = {row.name: row for row in fields(_KINDS[model])}
    for key in rows:
        if key not in known:
            raise SensorError(f"{path}: unknown key {model}.{key}")
    for key, row in known.items():
        if key not in rows and row.default is MISSING:
            raise SensorError(f"{path}: missing {model}.{key}")
    part = _KINDS[model](**{key: _number(path, model, known[key], value) for key, value in rows.items()})
    if isinstance(part, Encoder):
        _check_ring(path, model, part)
    return part


def _number(path: Path, model: str, row: Field, value: Any) -> float:
    where = f"{path}: {model}.{row.name} is {value!r}"
    whole = row.type is int
    if isinstance(value, bool) or not isinstance(value, int if whole else int | float):
        raise SensorError(f"{where}, not a {'whole ' if whole else ''}number")
    if not math.isfinite(value):
        raise SensorError(f"{where}, not a finite number")
    if value < 0:
        raise SensorError(f"{where}, below zero")
    if value == 0 and (row.name in _ABOVE_ZERO or whole):
        raise SensorError(f"{where}; it must be above")
    if value > _AT_MOST.get(row.name, math.inf):
        raise SensorError(f"{where}, above {_AT_MOST[row.name]:g}")
    return value if whole else float(value)


def _check_ring(path: Path, model: str, ring: Encoder) -> None:
    # Eight sigma of an edge and the steepest of the runout must leave a gap between two teeth.
    left = 1.0 - 8.0 * ring.edge_error - ring.runout * 2.0 * math.pi / ring.teeth
    if left <= 0.0:
        raise SensorError(
            f"{path}: {model}.edge_error {ring.edge_error:g} and runout {ring.runout:g} leave no gap "
            f"between two of {ring.teeth} teeth"
        )
