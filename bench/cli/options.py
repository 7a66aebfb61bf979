"""Options that several commands share, and how they become parts of the bench."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from bench.laps.lap import Lap
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
SensorsName = Annotated[
    str,
    typer.Option(
        "--sensors",
        metavar="NAME|FILE",
        help="datasheet (noise, bias, filters), ideal (for recordings of real sensors), or a .toml file.",
    ),
]
SensorSeed = Annotated[int, typer.Option("--seed", help="Draws the sensors' imperfections.")]
Map = Annotated[
    Path | None,
    typer.Option("--map", metavar="FILE", help="Which signal of the file is which channel (.toml)."),
]
Repair = Annotated[
    bool, typer.Option("--repair", help="Mend the time base: gaps, jitter, clock jumps, repetitions.")
]
BusName = Annotated[
    str,
    typer.Option("--bus", metavar="IFACE[:CHANNEL]", help="A python-can interface, e.g. socketcan:vcan0."),
]


def open_lap(path: Path, map_file: Path | None, repair: bool) -> "Lap":
    """The lap the options name; what was found wrong with it, or mended, is said on stderr."""
    from bench.laps.channel_map import load_map
    from bench.laps.files import read_lap

    lap = read_lap(path, load_map(map_file) if map_file else None, repair)
    for line in lap.damage:
        typer.echo(f"bench: lap: {path}: {line}", err=True)
    return lap


def build_ecu(role: str, host: str, model: Path | None, elf: Path | None) -> "Build":
    """The ECU the options ask for."""
    from targets.ecus import build

    return build(role, host, model, elf)
