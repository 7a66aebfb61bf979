"""Sweeps: a parameter as a list or a range, and every combination of them. Pure."""

import math
from collections.abc import Mapping
from itertools import product
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Discriminator, Field, PlainValidator, Tag

MOST = 100_000
"""Points of a sweep: more are a slip of the decimal point."""
LARGEST = 1e12
"""Of a parameter, either way; no unit here makes more of it."""


def _scalar(value: Any) -> bool | int | float | str:
    if isinstance(value, bool | str) or (isinstance(value, int | float) and abs(value) <= LARGEST):
        return value
    raise ValueError(f"input is neither a word nor a number of at most {LARGEST:g}")


Scalar = Annotated[bool | int | float | str, PlainValidator(_scalar)]
Number = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]
LIST, RANGE = "a list", "a range"


class Range(BaseModel):
    """Numbers from `from` to `to`, both included, `step` apart."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    first: Annotated[Number, Field(alias="from")]
    to: Number
    step: Annotated[Number, Field(gt=0)]

    def values(self) -> list[Scalar]:
        """The numbers, each rounded to the step's own digits: 0.9 + 3 * 0.05 is 1.05."""
        # a millionth of a step, for what rounding leaves of the last one
        steps = (self.to - self.first) / self.step + 1e-6
        if steps >= MOST:
            raise ValueError(f"{steps:.0f} steps from {self.first:g} to {self.to:g}; {MOST} are the most")
        count = math.floor(steps) + 1
        return [_tidy(self.first + k * self.step) for k in range(max(count, 0))]


def _kind(given: Any) -> str:
    return RANGE if isinstance(given, dict | Range) else LIST


Values = Annotated[Annotated[list[Scalar], Tag(LIST)] | Annotated[Range, Tag(RANGE)], Discriminator(_kind)]


def points(sweep: Mapping[str, Values]) -> list[dict[str, Scalar]]:
    """Every combination, the first parameter outermost; one empty point for no sweep at all.

    Raises ValueError naming the parameter that has no value or the same one twice, and for too many of them.
    """
    columns = []
    for name, values in sweep.items():
        column = values.values() if isinstance(values, Range) else list(values)
        if not column:
            raise ValueError(f"sweep.{name}: has no value")
        if len({repr(value) for value in column}) < len(column):
            raise ValueError(f"sweep.{name}: has a value twice")
        columns.append([(name, value) for value in column])
    count = math.prod(len(column) for column in columns)
    if count > MOST:
        raise ValueError(f"sweep: {count} combinations; {MOST} are the most")
    return [dict(point) for point in product(*columns)]


def _tidy(value: float) -> int | float:
    number: Any = round(value, 9)
    return int(number) if number == int(number) else float(number)
