"""Sweeps: a parameter as a list or a range, and every combination of them. Pure."""

import math
from collections.abc import Mapping
from itertools import product
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

MOST = 100_000
"""Points of one range: more are a slip of the decimal point."""

Scalar = bool | int | float | str


class Range(BaseModel):
    """Numbers from `from` to `to`, both included, `step` apart."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    first: Annotated[float, Field(alias="from")]
    to: float
    step: Annotated[float, Field(gt=0)]

    def values(self) -> list[Scalar]:
        """The numbers, each rounded to the step's own digits: 0.9 + 3 * 0.05 is 1.05."""
        # half a millionth of a step, for what rounding leaves of the last one
        count = math.floor((self.to - self.first) / self.step + 1e-6) + 1
        if count > MOST:
            raise ValueError(f"{count} steps from {self.first:g} to {self.to:g}")
        return [_tidy(self.first + k * self.step) for k in range(max(count, 0))]


Values = list[Scalar] | Range


def points(sweep: Mapping[str, Values]) -> list[dict[str, Scalar]]:
    """Every combination, the first parameter outermost; one empty point for no sweep at all.

    Raises ValueError naming the parameter that has no value or the same one twice.
    """
    columns = []
    for name, values in sweep.items():
        column = values.values() if isinstance(values, Range) else list(values)
        if not column:
            raise ValueError(f"sweep.{name}: has no value")
        if len({repr(value) for value in column}) < len(column):
            raise ValueError(f"sweep.{name}: has a value twice")
        columns.append([(name, value) for value in column])
    return [dict(point) for point in product(*columns)]


def _tidy(value: float) -> int | float:
    number: Any = round(value, 9)
    return int(number) if number == int(number) else float(number)
