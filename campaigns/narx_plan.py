"""Campaigns of soft sensors as TOML: the networks of Table III.2, chapter III's curves, leave one out."""

from typing import Annotated, Literal

from pydantic import Field

from campaigns.fields import Campaign, Count, Laps, Seed


class NarxGrid(Campaign):
    """Table III.2: every N with every d_in, several seeds each, and which of them pass.

    samples: training samples drawn for each network. iterations: at most, of each stage of the recipe.
    """

    kind: Literal["narx_grid"]
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


class NarxPerformance(Campaign):
    """Section III.4: Er, REC and SOE of a network beside the half-car sensor's."""

    kind: Literal["narx_performance"]
    training: Laps
    test: Laps
    sensors: str = "datasheet"


class NarxLeaveOneOut(Campaign):
    """Recorded laps: trained on all but one, measured on that one, beside a linear filter as long."""

    kind: Literal["narx_leave_one_out"]
    neurons: Count = 15
    delays: Count = 10
    seeds: list[Seed] = Field([0], min_length=1)
    recipe: str = "linear"


SoftSensorCampaign = NarxGrid | NarxPerformance | NarxLeaveOneOut
KINDS: dict[str, type[SoftSensorCampaign]] = {
    "narx_grid": NarxGrid,
    "narx_performance": NarxPerformance,
    "narx_leave_one_out": NarxLeaveOneOut,
}
