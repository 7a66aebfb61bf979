"""`bench ecu`: an emulated ECU on a live bus."""

from typing import Annotated

import typer

from bench.cli.options import BusName, Elf, Host, Model, build_ecu
from bench.cli.stop import stoppable


def ecu(
    name: Annotated[str, typer.Argument(metavar="NAME", help="ifd or soft_sensor.")],
    bus: BusName,
    on: Host = "mcu",
    model: Model = None,
    elf: Elf = None,
    seconds: Annotated[
        float | None, typer.Option(min=0, help="Stop after so long.  [default: Ctrl-C]")
    ] = None,
) -> None:
    """Put an ECU on a live CAN bus, in wall time, until Ctrl-C."""
    from bench.bus.live import LiveBus
    from bench.live import rehearse, serve

    build = build_ecu(name, on, model, elf)
    device = build.power_on()
    with LiveBus(bus) as live, stoppable():
        try:
            rehearse(build.power_on())
            sent = serve(
                device,
                live,
                seconds=seconds,
                ready=lambda: typer.echo(f"ecu {name} on {bus}, running on {on}; Ctrl-C ends it", err=True),
            )
        except KeyboardInterrupt:
            return
    typer.echo(f"{sent} frames sent", err=True)
