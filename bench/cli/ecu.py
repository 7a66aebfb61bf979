"""`bench ecu`: an emulated ECU on a live bus."""

from contextlib import suppress
from typing import Annotated

import typer

from bench.cli.options import (
    LATE_LIMIT_MS,
    Bitrate,
    BusName,
    Elf,
    Host,
    LateLimit,
    Model,
    build_ecu,
    ms_to_ns,
)
from bench.cli.stop import stoppable


def ecu(
    name: Annotated[str, typer.Argument(metavar="NAME", help="ifd or soft_sensor.")],
    bus: BusName,
    bitrate: Bitrate = 500_000,
    on: Host = "mcu",
    model: Model = None,
    elf: Elf = None,
    late_limit: LateLimit = LATE_LIMIT_MS,
    seconds: Annotated[
        float | None, typer.Option(min=0, help="Stop after so long.  [default: Ctrl-C]")
    ] = None,
) -> None:
    """Put an ECU on a live CAN bus, in wall time, until Ctrl-C."""
    from bench.bus.live import LiveBus
    from bench.serve import Served, rehearse, serve

    build = build_ecu(name, on, model, elf)
    device = build.power_on()
    served = Served(ms_to_ns(late_limit))
    with LiveBus(bus, bitrate) as live, stoppable(), suppress(KeyboardInterrupt):
        rehearse(build.power_on())
        serve(
            device,
            live,
            seconds=seconds,
            ready=lambda: typer.echo(f"ecu {name} on {bus}, running on {on}; Ctrl-C ends it", err=True),
            served=served,
        )
    typer.echo(
        f"{served.sent} frames sent in {served.lasted_ns / 1e9:.1f} s; behind the clock by "
        f"{served.worst_behind_ns / 1e6:.2f} ms at worst",
        err=True,
    )
    if complaint := served.complaint():
        typer.echo(complaint, err=True)
