"""The published figures, and what the thesis calls its faults."""

import tomllib
from functools import cache
from pathlib import Path
from typing import Any

NAMES = {
    "open": "Open circuit",
    "short": "Short circuit",
    "hold": "Hold",
    "uncalibration": "Losing calibration",
}


def published_road() -> dict[str, Any]:
    """What stands beside a road trial's tables: CD and TD_s by condition, steps by code, in us."""
    # Three rows of Table V.13, which we read as three clocks: the text names 22 MHz, the slowest.
    codes = zip(("initial", "compiler", "final"), thesis()["firmware"]["time_us"][0], strict=True)
    return {**thesis()["road"], "steps": {f"thesis, {name} C, 22 MHz": figures for name, figures in codes}}


@cache
def thesis() -> dict[str, Any]:
    """The published figures."""
    return tomllib.loads((Path(__file__).parent / "thesis.toml").read_text(encoding="utf-8"))
