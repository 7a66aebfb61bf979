"""Numbers within limits: one refusal, worded the same for every part of a road."""

from typing import Any

from bench.errors import RouteError

HIGHEST_M = 10_000.0  # no road is higher: what is comes from a damaged file


def check_number(name: str, value: Any, low: float, high: float) -> None:
    """RouteError, naming the value, unless it is a number from `low` to `high`."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        raise RouteError(f"{name} is {value!r}, not a number from {low:g} to {high:g}")


def check_whole(name: str, value: Any, low: int, high: int) -> None:
    """RouteError, naming the value, unless it is a whole number from `low` to `high`."""
    if isinstance(value, bool) or not isinstance(value, int):
        raise RouteError(f"{name} is {value!r}, not a whole number")
    check_number(name, value, low, high)
