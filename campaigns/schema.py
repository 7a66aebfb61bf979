"""What a store's documents hold, by the kind of trial: a damaged store is refused where it is read.

Belongs here: the shape of what this version writes. Never: a figure made of it, how it is stored.
"""

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from campaigns.errors import CampaignError
from campaigns.store import Document, Row

Ns = int | None
"""An instant in ns after the lap's start, None for what did not happen."""
Figure = float | None


class _Shape(BaseModel):
    model_config = ConfigDict(strict=True, frozen=True, allow_inf_nan=False)


class _Ecu(_Shape):
    ecu: str
    runs_on: Literal["mcu", "host"]


class _Campaign(_Shape):
    name: str
    title: str
    stands_for: str
    conditions: list[str]
    plan: dict[str, Any]
    laps: list[str] | None
    versions: dict[str, str]
    ecu: list[_Ecu] = Field([])


class _RoadTrial(_Shape):
    kind: Literal["road"]
    condition: str
    parameters: dict[str, bool | int | float | str]
    lap: dict[str, str | int | float | None]
    fault: str
    ftti_s: Figure
    ecu: _Ecu


class _Steps(_Shape):
    n: int
    cycles: int
    squares: int
    least: int
    most: int
    hz: int


class _RoadResult(_Shape):
    outcome: Literal["CD", "MD", "FA", "ID", "INVALID", "OK"]
    reason: str
    named: str | None
    t_cmd_ns: Ns
    t_active_ns: Ns
    t_obs_ns: Ns
    t_alarm_ns: Ns
    t_heal_ns: Ns
    td_ns: Ns
    alarms: int
    ridden_ns: int
    steps: _Steps


class _OfflineTrial(_Shape):
    kind: Literal["offline"]
    condition: str
    feedback: str
    fault: str


class _Other(_Shape):
    first_alarm_ns: Ns
    named: str | None


class _OfflineResult(_Shape):
    t_active_ns: Ns
    first_alarm_ns: dict[str, list[list[Ns]]] | None
    others: dict[str, _Other] = Field({})


class _SoeTrial(_Shape):
    kind: Literal["offline_soe"]
    feedback: str


class _Curve(_Shape):
    beyond: dict[str, float]
    worst_tenth_percent: float
    worst_hundredth_percent: float
    tolerance_percent: list[float]
    share: list[float]


class _SoeResult(_Shape):
    curves: dict[Annotated[str, Field(pattern=r"^\d{1,9}$")], _Curve]


class _GridTrial(_Shape):
    kind: Literal["narx_grid"]
    neurons: int
    delays: int
    seed: int


class _GridResult(_Shape):
    training_percent: Figure
    test_percent: Figure


class _Frame(_Shape):
    t0_ns: int
    period_ns: Annotated[int, Field(gt=0)]
    measured_mm: list[float]
    predicted_mm: list[float]
    residual_pct: list[Figure]


SHAPES: Mapping[str, tuple[type[_Shape], type[_Shape]]] = {
    "road": (_RoadTrial, _RoadResult),
    "offline": (_OfflineTrial, _OfflineResult),
    "offline_soe": (_SoeTrial, _SoeResult),
    "narx_grid": (_GridTrial, _GridResult),
}
"""Kind of a trial -> what its document and its result hold."""


def check_campaign(campaign: Document) -> None:
    """Raise CampaignError for what is no campaign's document."""
    _check(_Campaign, campaign, "campaign")


def check_row(row: Row, kinds: Sequence[str]) -> None:
    """Raise CampaignError for a row that is no trial of these kinds, or no result of one."""
    kind = row.trial.get("kind")
    if not isinstance(kind, str) or kind not in kinds:
        raise CampaignError(f"trial {row.id}: kind is {kind!r}, none of {', '.join(kinds)}")
    trial, result = SHAPES[kind]
    _check(trial, row.trial, f"trial {row.id}")
    _check(result, row.result, f"result of trial {row.id}")


def check_frame(frame: Document, id: str) -> None:
    """Raise CampaignError for what is no freeze frame."""
    _check(_Frame, frame, f"freeze frame of trial {id}")
    if len({len(frame[name]) for name in ("measured_mm", "predicted_mm", "residual_pct")}) > 1:
        raise CampaignError(f"freeze frame of trial {id}: its series differ in length")


def _check(shape: type[_Shape], document: Document, what: str) -> None:
    try:
        shape.model_validate(document)
    except ValidationError as problem:
        first = problem.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise CampaignError(f"{what}: {where}: {first['msg'].lower()}") from None
