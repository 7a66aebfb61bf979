"""Options that several commands share, and how they become parts of the bench."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from targets.ecus import Build

EcuName = Annotated[str, typer.Option("--ecu", help="The ECU under test: ifd or soft_sensor.")]
Host = Annotated[str, typer.Option("--on", help="Where it runs: mcu (emulated STM32F405) or host.")]
Model = Annotated[
    Path | None, typer.Option("--model", metavar="FILE", help="Calibration file.  [default: shipped]")
]
Elf = Annotated[
    Path | None, typer.Option("--elf", metavar="FILE", help="Firmware image.  [default: shipped]")
]
Faults = Annotated[
    list[str] | None,
    typer.Option(
        "--fault",
        metavar="SPEC",
        help="SENSOR:KIND[:PARAM=VALUE,...]@TIME[+DURATION], times in s; may be given more than once.",
    ),
]
BusName = Annotated[
    str,
    typer.Option("--bus", metavar="IFACE[:CHANNEL]", help="A python-can interface, e.g. socketcan:vcan0."),
]


def build_ecu(role: str, host: str, model: Path | None, elf: Path | None) -> "Build":
    """The ECU the options ask for."""
    from targets.ecus import build

    return build(role, host, model, elf)
