"""`bench fault`: arming, firing and clearing faults in a replay that is running."""

import json
from typing import Annotated, Any

import typer

app = typer.Typer(help="Faults in a replay that is running: arm, fire, clear, list.", no_args_is_help=True)

OnBus = Annotated[
    str | None,
    typer.Option("--bus", metavar="IFACE[:CHANNEL]", help="The replay's bus.  [default: the only one]"),
]
Spec = Annotated[str, typer.Argument(metavar="SPEC", help="SENSOR:KIND[:PARAM=VALUE,...][@now+DURATION]")]


@app.command()
def arm(fault: Spec, bus: OnBus = None) -> None:
    """Put a fault on the panel, to be fired by its number."""
    _ask({"do": "arm", "fault": fault}, bus)


@app.command()
def fire(
    fault: Annotated[
        str, typer.Argument(metavar="SPEC|NUMBER", help="A fault, or the number of an armed one.")
    ],
    bus: OnBus = None,
) -> None:
    """Let a fault act now."""
    _ask({"do": "fire", "fault": int(fault) if fault.isdecimal() else fault}, bus)


@app.command()
def clear(
    number: Annotated[int | None, typer.Argument(help="Of the fault.  [default: all]")] = None,
    bus: OnBus = None,
) -> None:
    """End a fault now."""
    _ask({"do": "clear", "fault": number}, bus)


@app.command(name="list")
def list_(bus: OnBus = None) -> None:
    """The faults of the replay, and what has become of them."""
    _ask({"do": "list"}, bus)


def _ask(request: dict[str, Any], bus: str | None) -> None:
    from bench.cli.control_socket import address, ask, running
    from bench.errors import BenchError, FaultError

    if bus is None:
        found = running()
        if len(found) != 1:
            names = ", ".join(path.stem for path in found)
            raise BenchError(
                f"replays are running on {names}: name one with --bus" if found else "no replay runs"
            )
        path = found[0]
    else:
        path = address(bus)
    reply = json.loads(ask(path, json.dumps(request).encode()))
    if "error" in reply:
        raise FaultError(reply["error"].removeprefix("fault: "))
    _print(reply)


def _print(reply: dict[str, Any]) -> None:
    from rich.console import Console
    from rich.table import Table

    def s(value: float | None) -> str:
        return "-" if value is None else f"{value:.3f}"

    table = Table("", "fault", "state", "t_cmd s", "t_active s", "t_end s", box=None, pad_edge=False)
    for row in reply["faults"]:
        instants = (s(row.get(name)) for name in ("t_cmd_s", "t_active_s", "t_end_s"))
        table.add_row(str(row["number"]), row["spec"], row["state"], *instants)
    console = Console()
    console.print(f"bench time {reply['t_s']:.3f} s", highlight=False)
    console.print(table)
