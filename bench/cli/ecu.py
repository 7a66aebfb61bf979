"""`bench ecu`: an emulated ECU on a live bus."""

from contextlib import suppress
from typing import Annotated

import typer

from bench.cli.options import Bitrate, BusName, Elf, Host, Model, build_ecu
from bench.cli.stop import stoppable


def ecu(
    name: Annotated[str, typer.Argument(metavar="NAME", help="ifd or soft_sensor.")],
    bus: BusName,
    bitrate: Bitrate = 500_000,
    on: Host = "mcu",
    model: Model = None,
    elf: Elf = None,
    seconds: Annotated[
        float | None, typer.Option(min=0, help="Stop after so long.  [default: Ctrl-C]")
    ] = None,
) -> None:
    """Put an ECU on a live CAN bus, in wall time, until Ctrl-C."""
    from bench.bus.live import LiveBus
    from bench.serve import BEHIND_NS, Served, rehearse, serve

    build = build_ecu(name, on, model, elf)
    device = build.power_on()
    served = Served()
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
    if served.behind:
        typer.echo(f"did not keep up: {served.behind} times {BEHIND_NS / 1e6:g} ms or more behind", err=True)
