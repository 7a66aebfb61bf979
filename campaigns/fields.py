"""What campaign files of every kind are made of: their heads, counts, seeds, names, simulated laps."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Count = Annotated[int, Field(ge=1, le=100_000, strict=True)]
Seed = Annotated[int, Field(ge=0, lt=2**63, strict=True)]
Line = Annotated[str, Field(max_length=200, pattern=r"^[^\x00-\x1f\x7f-\x9f]*$")]
"""What is printed in one line: no control characters."""
Name = Annotated[Line, Field(min_length=1)]
Fault = Annotated[str, Field(min_length=1)]
"""A fault's specification without its instant; on the road it may have one, and is ridden at that."""


class Campaign(BaseModel):
    """The head of a validated campaign file."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    title: Line
    stands_for: Line


class Laps(BaseModel):
    """Simulated laps: `count` of a route, seeds counting up."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    route: str
    count: Count
    seed: Seed
    motorcycle: str = "gsxr1000"
