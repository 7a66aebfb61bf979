"""`bench lap`: generate, convert and show test laps.

Belongs here: options, progress and tables. Heavy imports are made in the commands: start-up is budgeted.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bench.errors import LapError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

app = typer.Typer(
    help="Test laps: simulate, convert, look at.", no_args_is_help=True, pretty_exceptions_enable=False
)


@app.command()
def generate(
    out: Annotated[Path, typer.Argument(help="Lap file (.parquet or .csv); with --count a folder.")],
    route: Annotated[
        str, typer.Option(help="mixed_5km, training, or a route's .toml file.", show_default=True)
    ] = "mixed_5km",
    motorcycle: Annotated[Path | None, typer.Option(help="A motorcycle's .toml file.")] = None,
    seed: Annotated[int, typer.Option(help="Road, rider and load are drawn from it.")] = 0,
    seconds: Annotated[
        float | None, typer.Option(help="Length of the lap; the whole route if left out.")
    ] = None,
    count: Annotated[int | None, typer.Option(help="So many laps, seeds counting up.")] = None,
    suffix: Annotated[
        str | None, typer.Option("--format", help="parquet or csv, with --count; parquet if left out.")
    ] = None,
) -> None:
    """Ride simulated laps on a GSX-R1000 and write all seven channels at 1 kHz."""
    from bench.laps.files import check_writable, format_of, write_lap
    from bench.plant.motorcycle import DEFAULT, load_motorcycle
    from bench.plant.route import checked_seed, load_route

    if count is not None and count < 1:
        raise LapError(f"--count is {count}; it must be at least 1")
    checked_seed(seed)
    chosen, machine = load_route(route), load_motorcycle(motorcycle or DEFAULT)
    if count is None and suffix is not None:
        raise LapError(f"--format {suffix} goes with --count; a single lap's suffix says its format")
    files = {seed: out}
    if count is not None:
        ending = (suffix or "parquet").removeprefix(".")
        files = {k: out / f"lap-{k}.{ending}" for k in range(seed, seed + count)}
        format_of(files[seed])
        _make_folder(out)
    check_writable(files[seed])

    from rich.console import Console
    from rich.progress import Progress

    from bench.plant.ride import ride

    screen = Console(stderr=True)
    # A bar in a log file would be noise; lines sent to a file must not be caught by the bar.
    with Progress(
        console=screen, transient=True, disable=not screen.is_terminal, redirect_stdout=sys.stdout.isatty()
    ) as bar:
        for k, path in bar.track(files.items(), description="riding"):
            lap = ride(chosen, machine, k, seconds)
            write_lap(lap, path)
            typer.echo(f"{path}: {lap.duration_ns / 1e9:.1f} s, {len(lap.channels)} channels, seed {k}")


@app.command()
def convert(
    source: Annotated[Path, typer.Argument(metavar="IN", help="Lap file to read.")],
    out: Annotated[
        Path, typer.Argument(metavar="OUT", help="Lap file to write; its suffix says the format.")
    ],
) -> None:
    """Write a lap in another format."""
    from bench.laps.files import check_writable, read_lap, write_lap

    check_writable(out)
    write_lap(read_lap(source), out)


@app.command()
def show(lap: Annotated[Path, typer.Argument(help="Lap file.")]) -> None:
    """Print what a lap holds: duration, rate, largest gap, and per channel its statistics and its course."""
    import numpy as np
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    from bench.laps.files import read_lap

    ride = read_lap(lap)
    steps_ns = np.diff(ride.t_ns)
    widest = int(np.argmax(steps_ns))
    table = Table(
        title=f"{escape(ride.source)}: {ride.duration_ns / 1e9:g} s, {len(ride.t_ns)} samples, "
        f"{1e9 / float(np.median(steps_ns)):g} Hz, largest gap {steps_ns[widest] / 1e6:g} ms "
        f"at {ride.t_ns[widest] / 1e9:g} s",
        title_justify="left",
        box=None,
        padding=(0, 1),
    )
    table.add_column("channel", no_wrap=True)
    for name in ("min", "mean", "max", "rms"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("peaks", no_wrap=True)
    for name, values in ride.channels.items():
        numbers = (values.min(), values.mean(), values.max(), np.sqrt(np.mean(values * values)))
        table.add_row(name, *(f"{number:.2f}" for number in numbers), sparkline(values))
    Console().print(table)


def sparkline(values: NDArray[np.float64], width: int = 24) -> str:
    """One line of blocks: the peaks of `width` equal parts, from the lowest peak to the highest."""
    import numpy as np

    peaks = np.array([part.max() for part in np.array_split(values, min(width, len(values)))])
    low, high = peaks.min(), peaks.max()
    heights = np.zeros(len(peaks)) if high == low else (peaks - low) / (high - low)
    return "".join("▁▂▃▄▅▆▇█"[min(7, int(8 * height))] for height in heights)


def _make_folder(path: Path) -> None:
    try:
        path.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise LapError(f"{path}: is a file; with --count it must be a folder") from None
    except OSError as error:
        raise LapError(f"{path}: cannot be made: {error.strerror}") from None
