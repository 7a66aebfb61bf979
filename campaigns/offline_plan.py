"""The offline campaign as TOML: section V.3's faults, and every L, n and T they are judged with."""

from itertools import pairwise
from typing import Annotated, Any, Literal

from pydantic import Field, field_validator

from campaigns.fields import Campaign, Count, Fault, Laps, Name, Seed

SAMPLE_MS = 10
"""The control loop's period: what L is counted in."""

Feedback = Literal["predicted", "measured"]
Window = Annotated[int, Field(ge=SAMPLE_MS, le=10_000, multiple_of=SAMPLE_MS, strict=True)]
Multiple = Annotated[int, Field(ge=1, le=1000, strict=True)]
Percent = Annotated[float, Field(gt=0, le=1000)]


class OfflineCampaign(Campaign):
    """Tables V.1-V.12: `faults_per_kind` faults of each kind in the laps of `test`, one a trial.

    faults: condition -> fault without its instant. L_ms: windows of (V.1), n: multiples of them for which the
    residual must stay above T_percent, each list increasing. t_max_s: what is found later is missed.
    feedback: what the network is fed back with, its own predictions or the measured stroke. model: a shipped
    calibration's name or a file. compare: another one, whose second detector and baselines run beside where
    `model` has none of its own.
    """

    kind: Literal["offline"]
    test: Laps
    sensors: str = "datasheet"
    model: str | None = None
    compare: str | None = None
    seed: Seed
    faults: Annotated[dict[Name, Fault], Field(min_length=1)]
    faults_per_kind: Count = 1000
    L_ms: list[Window] = Field([10, 20, 50, 100, 150, 200], min_length=1)
    n: list[Multiple] = Field([1, 2, 3, 4, 5], min_length=1)
    T_percent: list[Percent] = Field([10.0], min_length=1)
    t_max_s: Annotated[float, Field(gt=0, le=7200)] = 120.0
    feedback: list[Feedback] = Field(["predicted", "measured"], min_length=1)

    @field_validator("L_ms", "n", "T_percent")
    @classmethod
    def _increasing(cls, values: list[Any]) -> list[Any]:
        if any(b <= a for a, b in pairwise(values)):
            raise ValueError("each value must be larger than the one before")
        return values

    @field_validator("feedback")
    @classmethod
    def _distinct(cls, values: list[Any]) -> list[Any]:
        if len(set(values)) < len(values):
            raise ValueError("one is named twice")
        return values

    @field_validator("faults")
    @classmethod
    def _without_instant(cls, faults: dict[str, str]) -> dict[str, str]:
        from bench.errors import FaultError
        from bench.faults.spec import parse_fault

        for fault in faults.values():
            if "@" in fault:
                raise ValueError(f"{fault!r} has an instant, which the campaign draws: leave out the @")
            try:
                parse_fault(f"{fault}@0")
            except FaultError as error:
                raise ValueError(str(error)) from None
        return faults


def t_key(T_percent: float) -> str:
    """How a T is named in documents: 10 for 10 %."""
    return f"{T_percent:.15g}"
