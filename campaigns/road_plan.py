"""A road trial as TOML: which laps, under which faults, on which ECU, and what is swept. Pure."""

import re
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from campaigns.fields import Campaign, Count, Fault, Name, Seed
from campaigns.sweep import Scalar, Values, points

FAULT_FREE = "fault-free"
PLACES = re.compile(r"\{([a-z_]+)\}")
"""A swept parameter's place in a fault's specification, as in `rear_stroke:uncalibration:gain={gain}`."""

LOAD = "load_kg"
LAP_PARAMETERS = ("route", "motorcycle", LOAD)
"""What may be swept beside a fault's parameters: where and with what the laps are simulated, luggage too,"""
BENCH_PARAMETERS = ("sensors", "model")
"""through which instruments the ECU sees them, and which calibration it has,"""
DETECTOR = "detector_"
"""any setting of its detector, after this prefix,"""
PHASE = "phase_ms"
"""and where in the control period of 10 ms a fault comes."""

MOST_TRIALS = 1_000_000
"""Of one campaign: more would take years."""

Instant = Annotated[float, Field(ge=0, lt=1e9)]
"""In seconds: as many digits as a fault's specification has."""


class RoadPlan(Campaign):
    """A validated campaign file of kind `road`; see `road.toml` for what the fields mean."""

    kind: Literal["road"] = "road"
    route: str | Annotated[list[str], Field(min_length=1)]
    motorcycle: str = "gsxr1000"
    sensors: str = "datasheet"
    model: str | None = None
    laps: Count
    fault_free_laps: Annotated[int | None, Field(ge=0, le=100_000, strict=True)] = None
    claim_per_hour: Annotated[float | None, Field(ge=1e-9)] = None
    seed: Seed
    seconds: Annotated[float | None, Field(gt=0)] = None
    fault_window_s: tuple[Instant, Instant]
    td_max_s: Annotated[float, Field(gt=0, lt=1e9)] = 120.0
    ftti_s: Annotated[float | None, Field(gt=0)] = None
    faults: dict[Name, Fault]
    sweep: dict[str, Values] = Field({})

    @model_validator(mode="after")
    def _whole(self) -> Self:
        if FAULT_FREE in self.faults:
            raise ValueError(f"faults: {FAULT_FREE!r} is the laps without one")
        low, high = self.fault_window_s
        if low > high:
            raise ValueError(f"fault_window_s: {low} s comes after {high} s")
        if self.claim_per_hour is not None:
            if self.fault_free_laps is not None:
                raise ValueError("claim_per_hour: sizes the fault-free laps, leave out fault_free_laps")
            if self.seconds is None:
                raise ValueError("claim_per_hour: needs `seconds`, the length of a lap")
        places = {name for fault in self.faults.values() for name in PLACES.findall(fault)}
        for name in sorted(places - set(self.sweep)):
            raise ValueError(f"faults: {{{name}}} is not swept: [sweep] has no {name}")
        for name in self.sweep:
            known = (*LAP_PARAMETERS, *BENCH_PARAMETERS, PHASE)
            if name not in known and not name.startswith(DETECTOR) and name not in places:
                raise ValueError(
                    f"sweep.{name}: no fault has a {{{name}}}, and it is none of "
                    f"{', '.join(known)}, {DETECTOR}*"
                )
        points(self.sweep)
        cells = self.conditions()
        count = sum(self.laps if fault else self.healthy_laps for _, fault, _ in cells)
        if count > MOST_TRIALS:
            raise ValueError(f"{count} trials; {MOST_TRIALS} are the most")
        return self

    @property
    def healthy_laps(self) -> int:
        """How many laps are ridden without a fault: as many as asked for, or as the claim needs.

        Without an alarm in T hours the rate is at most 3 / T per hour (95 %): T = 3 / claim.
        """
        if self.claim_per_hour is not None and self.seconds is not None:
            return -int(-3.0 / self.claim_per_hour * 3600 // self.seconds)
        return self.laps if self.fault_free_laps is None else self.fault_free_laps

    def conditions(self) -> list[tuple[str, str, dict[str, Scalar]]]:
        """(condition, fault without its time, what is swept) of every cell, fault-free ones first.

        A parameter in a fault's specification makes no second cell of a fault that has no place for it.
        """
        cells: dict[str, tuple[str, str, dict[str, Scalar]]] = {}
        of_faults = {name for fault in self.faults.values() for name in PLACES.findall(fault)} | {PHASE}
        for name, fault in [(FAULT_FREE, ""), *self.faults.items()]:
            own = {*PLACES.findall(fault), PHASE} if fault else set()
            for point in points(self.sweep):
                mine = {key: value for key, value in point.items() if key not in of_faults or key in own}
                text = PLACES.sub(lambda match, mine=mine: _number(mine[match[1]]), fault)  # type: ignore[misc]
                cells.setdefault(repr((name, mine)), (name, text, mine))
        return list(cells.values())


def _number(value: Scalar) -> str:
    return value if isinstance(value, str) else repr(value)
