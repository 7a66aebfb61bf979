"""What a campaign is, and the trials it stands for. Pure: a file's text in, a list of trials out."""

from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from bench.toml import read_table
from campaigns.errors import CampaignError
from campaigns.narx_plan import KINDS, SoftSensorCampaign

HERE = Path(__file__).parent
FAULT_FREE = "fault-free"


class Campaign(BaseModel):
    """A validated campaign file; see `demo.toml` for what the fields mean."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    kind: Literal["road"] = "road"
    title: str
    stands_for: str
    route: str
    motorcycle: str = "gsxr1000"
    sensors: str = "datasheet"
    laps: Annotated[int, Field(ge=1, le=100_000, strict=True)]
    seed: Annotated[int, Field(ge=0, strict=True)]
    fault_window_s: tuple[Annotated[float, Field(ge=0)], Annotated[float, Field(ge=0)]]
    faults: dict[str, str]
    seconds: Annotated[float | None, Field(gt=0)] = None


@dataclass(frozen=True)
class Trial:
    """One lap under one condition.

    condition: a key of the campaign's faults, or FAULT_FREE. fault: its specification, '' for none. The lap's
    seed is its sensors', too.
    """

    condition: str
    route: str
    motorcycle: str
    sensors: str
    lap_seed: int
    fault: str
    seconds: float | None = None

    @property
    def id(self) -> str:
        """Derived from the content: the same trial has the same id in every campaign."""
        return sha256(repr(self).encode()).hexdigest()[:16]


NAMES = ("demo", "narx_grid", "narx_performance", "narx_leave_one_out")
"""Campaigns that come with the bench."""


def load(name: str) -> Campaign | SoftSensorCampaign:
    """The campaign of a shipped NAME or a FILE.toml; CampaignError, one line, for anything else."""
    if name not in NAMES and not name.endswith(".toml"):
        raise CampaignError(
            f"unknown campaign {name!r}; the known ones are {', '.join(NAMES)}, or a .toml file"
        )
    path = Path(name) if name.endswith(".toml") else HERE / f"{name}.toml"
    table = read_table(path, CampaignError)
    kinds: dict[str, type[Campaign | SoftSensorCampaign]] = {"road": Campaign, **KINDS}
    kind = table.get("kind", "road")
    if not isinstance(kind, str) or kind not in kinds:
        raise CampaignError(f"{path}: kind is {kind!r}, none of {', '.join(kinds)}")
    try:
        campaign = kinds[kind](**table)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        found = "" if first["type"] == "missing" else f" (is {first['input']!r})"
        raise CampaignError(f"{path}: {where}: {first['msg'].lower()}{found}") from None
    if not isinstance(campaign, Campaign):
        return campaign
    if FAULT_FREE in campaign.faults:
        raise CampaignError(f"{path}: faults: {FAULT_FREE!r} is the laps without one")
    low, high = campaign.fault_window_s
    if low > high:
        raise CampaignError(f"{path}: fault_window_s: {low} s comes after {high} s")
    return campaign


def expand(campaign: Campaign) -> list[Trial]:
    """The trials in the order of the tables: fault-free laps first, then each fault's."""
    from bench.faults.spec import parse_fault

    trials = []
    for number, (condition, fault) in enumerate([(FAULT_FREE, ""), *campaign.faults.items()]):
        for lap in range(campaign.laps):
            seed = campaign.seed + number * campaign.laps + lap
            faulty = condition != FAULT_FREE
            spec = str(parse_fault(f"{fault}@{_instant(campaign, seed)}")) if faulty else ""
            what = campaign.route, campaign.motorcycle, campaign.sensors
            trials.append(Trial(condition, *what, seed, spec, campaign.seconds))
    return trials


def _instant(campaign: Campaign, lap_seed: int) -> str:
    """A whole millisecond of the window, drawn from the lap's seed."""
    import numpy as np

    draw = np.random.Generator(np.random.PCG64(np.random.SeedSequence((lap_seed, 1))))
    low, high = (round(edge * 1000) for edge in campaign.fault_window_s)
    return f"{int(draw.integers(low, high + 1)) / 1000:.3f}"
