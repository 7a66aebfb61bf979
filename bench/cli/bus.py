"""`bench bus`: the hub of a bus between processes, in the foreground."""

from typing import Annotated

import typer

from bench.cli.stop import stoppable


def bus(
    channel: Annotated[str, typer.Argument(metavar="CHANNEL", help="Name of the bus.")] = "bus0",
    timed: Annotated[
        int | None,
        typer.Option(metavar="BITRATE", help="Arbitrate, at so many bit/s.  [default: as fast as it goes]"),
    ] = None,
    patience: Annotated[
        float, typer.Option(min=0.01, metavar="S", help="How long a client may hold up the others.")
    ] = 10.0,
    list_: Annotated[bool, typer.Option("--list", help="List the buses that are running, and end.")] = False,
) -> None:
    """Be a CAN bus for the processes of this user, `--bus strokebench:CHANNEL`, until Ctrl-C."""
    from bench.bus.hub.server import Hub
    from bench.bus.hub.start import running

    if list_:
        for name in running():
            typer.echo(f"strokebench:{name}")
        return
    pace = f"at {timed} bit/s" if timed is not None else "untimed"
    try:
        with stoppable(), Hub(channel, timed, patience_s=patience) as hub:
            typer.echo(f"bus strokebench:{channel}, {pace}; Ctrl-C ends it", err=True)
            hub.serve()
    except KeyboardInterrupt:
        return
