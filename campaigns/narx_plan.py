"""Campaigns of soft sensors as TOML: the networks of Table III.2, chapter III's curves, leave one out."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

Count = Annotated[int, Field(ge=1, le=100_000, strict=True)]
Seed = Annotated[int, Field(ge=0, strict=True)]


class Laps(BaseModel):
    """Simulated laps: `count` of a route, seeds counting up."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    route: str
    count: Count
    seed: Seed
    motorcycle: str = "gsxr1000"


class NarxGrid(BaseModel):
    """Table III.2: every N with every d_in, several seeds each, and which of them pass.

    samples: training samples drawn for each network. iterations: at most, of each stage of the recipe.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    kind: Literal["narx_grid"]
    title: str
    stands_for: str
    training: Laps
    test: Laps
    sensors: str = "datasheet"
    neurons: Annotated[list[Count], Field(min_length=1)]
    delays: Annotated[list[Count], Field(min_length=1)]
    seeds: Annotated[list[Seed], Field(min_length=1)]
    recipe: str = "series-parallel"
    samples: Count = 60_000
    iterations: Count = 100
    pass_percent: Annotated[float, Field(gt=0)] = 10.0


class NarxPerformance(BaseModel):
    """Section III.4: Er, REC and SOE of a network beside the half-car sensor's."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    kind: Literal["narx_performance"]
    title: str
    stands_for: str
    training: Laps
    test: Laps
    sensors: str = "datasheet"


class NarxLeaveOneOut(BaseModel):
    """Recorded laps: trained on all but one, measured on that one, beside a linear filter as long."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    kind: Literal["narx_leave_one_out"]
    title: str
    stands_for: str
    neurons: Count = 15
    delays: Count = 10
    seeds: Annotated[list[Seed], Field(min_length=1)] = [0]
    recipe: str = "linear"


SoftSensorCampaign = NarxGrid | NarxPerformance | NarxLeaveOneOut
KINDS: dict[str, type[SoftSensorCampaign]] = {
    "narx_grid": NarxGrid,
    "narx_performance": NarxPerformance,
    "narx_leave_one_out": NarxLeaveOneOut,
}
