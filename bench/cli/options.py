"""Options that several commands share, and how they become parts of the bench."""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

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
        help="PLACE:KIND[:PARAM=VALUE,...]@TIME[+DURATION], times in s (bench faults list); more than once.",
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
Workers = Annotated[int | None, typer.Option(help="Processes.  [default: all cores]")]
BusName = Annotated[
    str,
    typer.Option("--bus", metavar="IFACE[:CHANNEL]", help="A python-can interface, e.g. socketcan:vcan0."),
]

Bitrate = Annotated[int, typer.Option(min=10_000, max=1_000_000, help="Of the bus, bit/s.")]

Keys = Annotated[
    list[str] | None,
    typer.Option(
        "--key", metavar="KEY=SPEC", help="A key fires SENSOR:KIND[:PARAM=VALUE,...][@now+DURATION]."
    ),
]

LateLimit = Annotated[
    float,
    typer.Option(metavar="MS", min=0.1, max=1000, help="So late is too late; a control period is 10."),
]
LATE_LIMIT_MS = 10.0

Rate = Annotated[
    int | None,
    typer.Option(metavar="HZ", min=1, max=1000, help="Of every message.  [default: the DBC's, 100 Hz]"),
]


def ms_to_ns(ms: float) -> int:
    """Milliseconds as an option gives them, in whole nanoseconds."""
    return round(ms * 1e6)


def json_of(what: str) -> Any:
    """The option of a file for `what`; see `write_json`."""
    return typer.Option("--json", metavar="OUT", help=f"Write {what} as JSON.")


def write_json(out: Path | None, result: Any) -> None:
    """Write a command's result, whole or not at all, to the file of its --json if that was given."""
    from bench.whole import whole

    if out:
        with whole(out) as part:
            part.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")


@dataclass(frozen=True)
class Laps:
    """A folder of laps, and how they are read."""

    folder: Path
    map_file: Path | None = None
    repair: bool = False

    def paths(self) -> list[Path]:
        """The lap files, by name; LapError if there is none."""
        from bench.errors import LapError
        from bench.laps.files import FORMATS

        if not self.folder.is_dir():
            raise LapError(f"{self.folder}: no such folder")
        files = sorted(path for path in self.folder.iterdir() if path.suffix.lower() in FORMATS)
        if not files:
            raise LapError(f"{self.folder}: no lap in it ({', '.join(FORMATS)})")
        return files

    def each(self) -> "Iterator[tuple[Path, Lap]]":
        """The laps with their files, one at a time: hundreds of them need not fit in memory."""
        for path in self.paths():
            yield path, open_lap(path, self.map_file, self.repair)

    def read(self) -> "list[Lap]":
        """All of them."""
        return [lap for _, lap in self.each()]


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
