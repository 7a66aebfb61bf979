"""Options of a replay that a ground station works, and the campaign file of what was done."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from bench.script import Script
    from bench.session import Session

Mavlink = Annotated[
    str | None,
    typer.Option(
        "--mavlink",
        metavar="[HOST:]PORT",
        help="Tell the ground station there by UDP, e.g. 14550; it may answer.  [default host: 127.0.0.1]",
    ),
]
AllowInject = Annotated[
    bool, typer.Option("--allow-inject", help="Let MAV_CMD_INJECT_FAILURE from this machine act.")
]
InjectFrom = Annotated[
    str | None,
    typer.Option("--inject-from", metavar="ADDRESS", help="Let it act from this IP address instead."),
]
Tlog = Annotated[
    Path | None, typer.Option("--tlog", metavar="OUT", help="Record the ground station's link (.tlog).")
]
SessionOut = Annotated[
    Path | None,
    typer.Option("--session", metavar="OUT", help="Write the faults as a campaign file (.toml)."),
]


def write_session(out: Path, session: "Session", script: "Script") -> None:
    """Write what `session` makes of the faults that `script` ended with."""
    from bench.whole import whole

    with whole(out) as part:
        part.write_text(session.toml(script), encoding="utf-8")
