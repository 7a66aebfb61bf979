"""Campaign files: the shipped ones by name, others by path, each checked as its kind asks."""

from difflib import get_close_matches
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from bench.toml import read_table
from campaigns.errors import CampaignError
from campaigns.narx_plan import KINDS as SOFT_SENSOR_KINDS
from campaigns.narx_plan import SoftSensorCampaign
from campaigns.offline_plan import OfflineCampaign
from campaigns.road_plan import RoadPlan

HERE = Path(__file__).parent

Plan = RoadPlan | OfflineCampaign | SoftSensorCampaign
KINDS: dict[str, type[Plan]] = {"road": RoadPlan, "offline": OfflineCampaign, **SOFT_SENSOR_KINDS}

NAMES = (
    "demo",
    "offline",
    "road",
    "road_random",
    "fault_free",
    "detection",
    "narx_grid",
    "narx_performance",
    "narx_leave_one_out",
)
"""Campaigns that come with the bench."""


def load(name: str) -> Plan:
    """The campaign of a shipped NAME or a FILE.toml; CampaignError, one line, for anything else."""
    if name not in NAMES and not name.endswith(".toml"):
        near = get_close_matches(name, NAMES, 1)
        hint = f"; did you mean {near[0]}?" if near else ""
        raise CampaignError(
            f"unknown campaign {name!r}{hint} The known ones are {', '.join(NAMES)}, or a .toml file"
            if near
            else f"unknown campaign {name!r}; the known ones are {', '.join(NAMES)}, or a .toml file"
        )
    path = Path(name) if name.endswith(".toml") else HERE / f"{name}.toml"
    table = read_table(path, CampaignError)
    kind = table.get("kind", "road")
    if not isinstance(kind, str) or kind not in KINDS:
        raise CampaignError(f"{path}: kind is {kind!r}, none of {', '.join(KINDS)}")
    try:
        return KINDS[kind](**table)
    except ValidationError as error:
        raise CampaignError(f"{path}: {_told(error.errors()[0], KINDS[kind])}") from None


def _told(error: ErrorDetails, kind: type[BaseModel]) -> str:
    where = ".".join(str(part) for part in error["loc"])
    if error["type"] == "extra_forbidden":
        key = str(error["loc"][-1])
        known = _keys(kind, error["loc"][:-1])
        near = get_close_matches(key, known, 1, 0.5)
        return f"unknown key {where}; did you mean {near[0]}?" if near else f"unknown key {where}"
    if error["type"] == "value_error" and not where:
        return str(error["ctx"]["error"])
    found = "" if error["type"] == "missing" else f" (is {error['input']!r})"
    return f"{where}: {error['msg'].lower()}{found}"


def _keys(kind: type[BaseModel], path: tuple[Any, ...]) -> list[str]:
    """The keys known at that place of a campaign file."""
    for part in path:
        field = kind.model_fields.get(str(part))
        inner = getattr(field, "annotation", None)
        if not (isinstance(inner, type) and issubclass(inner, BaseModel)):
            return []
        kind = inner
    return [field.alias or name for name, field in kind.model_fields.items()]
