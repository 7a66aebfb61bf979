"""`bench ecu`: an emulated ECU on a live bus."""

from typing import Annotated

import typer

from bench.cli.options import BusName, Elf, Host, Model, build_ecu


def ecu(
    name: Annotated[str, typer.Argument(metavar="NAME", help="ifd or soft_sensor.")],
    bus: BusName,
    on: Host = "mcu",
    model: Model = None,
    elf: Elf = None,
    seconds: Annotated[float | None, typer.Option(help="Stop after so long.  [default: Ctrl-C]")] = None,
) -> None:
    """Put an ECU on a live CAN bus, in wall time, until Ctrl-C."""
    from rich.console import Console

    from bench.bus.live import LiveBus
    from bench.live import serve

    build = build_ecu(name, on, model, elf)
    device = build.power_on()
    console = Console(stderr=True)
    with LiveBus(bus) as live:
        try:
            sent = serve(
                device,
                live,
                seconds=seconds,
                ready=lambda: console.print(f"ecu {name} on {bus}, running on {on}; Ctrl-C ends it"),
            )
        except KeyboardInterrupt:
            return
    console.print(f"{sent} frames sent")
