"""Campaign files: the shipped ones by name, others by path, each checked as its kind asks."""

import re
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
from campaigns.sweep import RANGE, Range

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
        hint = f"did you mean {near[0]}? The" if near else "the"
        raise CampaignError(
            f"unknown campaign {name!r}; {hint} known ones are {', '.join(NAMES)}, or a .toml file"
        )
    path = Path(name) if name.endswith(".toml") else HERE / f"{name}.toml"
    table = read_table(path, CampaignError)
    kind = table.get("kind", "road")
    if not isinstance(kind, str) or kind not in KINDS:
        raise CampaignError(f"{path}: kind is {_shown(kind)}, none of {', '.join(KINDS)}")
    try:
        return KINDS[kind](**table)
    except ValidationError as error:
        # a key mistyped is also one missing
        errors = sorted(error.errors(), key=lambda each: each["type"] != "extra_forbidden")
        raise CampaignError(f"{path}: {_told(errors[0], KINDS[kind])}") from None


def _told(error: ErrorDetails, kind: type[BaseModel]) -> str:
    loc = tuple(part for part in error["loc"] if not _UNION.match(str(part)))
    where = ".".join(map(str, loc))
    if error["type"] == "extra_forbidden":
        known = _keys(Range if RANGE in error["loc"] else kind, () if RANGE in error["loc"] else loc[:-1])
        near = get_close_matches(str(loc[-1]), known, 1, 0.5)
        return f"unknown key {where}; did you mean {near[0]}?" if near else f"unknown key {where}"
    if error["type"] == "value_error":
        reason = str(error["ctx"]["error"])
        return f"{where}: {reason} (is {_shown(error['input'])})" if where else reason
    found = "" if error["type"] == "missing" else f" (is {_shown(error['input'])})"
    return f"{where}: {error['msg'].lower()}{found}"


_UNION = re.compile(r"str$|list\[|a list$|a range$|\[key\]$")
"""What pydantic adds to a value's place: which member of a union it was tried as."""
_LONGEST = 80


def _shown(value: object) -> str:
    """A value in a few words, however long or deep it is."""
    try:
        text = repr(value)
    except (ValueError, RecursionError):  # more digits, or nested deeper, than Python writes
        return "too long to show"
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."


def _keys(kind: type[BaseModel], path: tuple[Any, ...]) -> list[str]:
    """The keys known at that place of a campaign file."""
    for part in path:
        field = kind.model_fields.get(str(part))
        inner = getattr(field, "annotation", None)
        if not (isinstance(inner, type) and issubclass(inner, BaseModel)):
            return []
        kind = inner
    return [field.alias or name for name, field in kind.model_fields.items()]
