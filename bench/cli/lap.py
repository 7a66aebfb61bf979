"""`bench lap`: generate, convert, show and compare test laps.

Belongs here: the two commands that write laps; those that look at laps have files of their own. Heavy imports
are made in the commands: start-up is budgeted.
"""

from __future__ import annotations

import sys
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bench.cli import lap_compare, lap_show
from bench.cli.options import Map, Repair, open_lap
from bench.cli.stop import stoppable
from bench.errors import LapError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from bench.plant.motorcycle import Motorcycle
    from bench.plant.route import Route

app = typer.Typer(
    help="Test laps: simulate, convert, look at.", no_args_is_help=True, pretty_exceptions_enable=False
)


def shipped(kind: str) -> str:
    """The names of the routes or motorcycles that come with the bench, without importing what reads them."""
    folder = Path(__file__).parents[1] / "plant" / kind
    return ", ".join(sorted(path.stem for path in folder.glob("*.toml")))


@app.command()
def generate(
    out: Annotated[Path, typer.Argument(help="Lap file (.parquet or .csv); with --count a folder.")],
    route: Annotated[
        str, typer.Option(metavar="NAME|FILE", help=f"{shipped('routes')}, or a .toml file.")
    ] = "mixed_5km",
    motorcycle: Annotated[
        str, typer.Option(metavar="NAME|FILE", help=f"{shipped('motorcycles')}, or a .toml file.")
    ] = "gsxr1000",
    seed: Annotated[int, typer.Option(help="Road, rider and load are drawn from it.")] = 0,
    seconds: Annotated[
        float | None, typer.Option(help="Length of the lap; the whole route if left out.")
    ] = None,
    count: Annotated[int | None, typer.Option(help="So many laps, seeds counting up.")] = None,
    suffix: Annotated[
        str | None, typer.Option("--format", help="parquet or csv, with --count; parquet if left out.")
    ] = None,
    workers: Annotated[int, typer.Option(help="Processes; the laps are the same for any number.")] = 1,
) -> None:
    """Ride simulated laps on a motorcycle and write all seven channels at 1 kHz.

    Ctrl-C ends it after the laps that are being ridden; every file there is is a whole lap.
    """
    from bench.laps.files import check_writable, format_of
    from bench.plant.motorcycle import load_motorcycle
    from bench.plant.ride import ride
    from bench.plant.route import checked_seed, load_route
    from bench.pool import results

    for name, value in (("--count", count), ("--workers", workers)):
        if value is not None and value < 1:
            raise LapError(f"{name} is {value}; it must be at least 1")
    checked_seed(seed)
    chosen, machine = load_route(route), load_motorcycle(motorcycle)
    if count is None and suffix is not None:
        raise LapError(f"--format {suffix} goes with --count; a single lap's suffix says its format")
    files = {seed: out}
    if count is not None:
        ending = (suffix or "parquet").removeprefix(".")
        files = {k: out / f"lap-{k}.{ending}" for k in range(seed, seed + count)}
        format_of(files[seed])
        _make_folder(out)
    check_writable(files[seed])
    if min(workers, len(files)) > 1:
        ride(chosen, machine, seed, 0.01)  # compiles: forked workers have it, others find it on disk
    jobs, ride_one = list(files.items()), partial(_ride, chosen, machine, seconds)
    with stoppable(), _progress(len(jobs)) as tell:
        try:
            with closing(results(ride_one, jobs, workers)) as ridden:
                for line in ridden:
                    typer.echo(line)
                    tell()
        except KeyboardInterrupt:
            typer.echo("bench: lap: stopped; what is written is whole", err=True)
            raise typer.Exit(130) from None


def _ride(route: Route, motorcycle: Motorcycle, seconds: float | None, job: tuple[int, Path]) -> str:
    """Ride and write one lap, and return the line about it."""
    from bench.laps.files import write_lap
    from bench.plant.ride import ride

    seed, path = job
    lap = ride(route, motorcycle, seed, seconds)
    write_lap(lap, path)
    return f"{path}: {lap.duration_ns / 1e9:.1f} s, {len(lap.channels)} channels, seed {seed}"


@contextmanager
def _progress(laps: int) -> Iterator[Callable[[], None]]:
    """A bar with the time left, nothing where no one looks; yields what to call after each lap."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("riding laps"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    screen = Console(stderr=True)
    # Drawn when a lap is done, not by a thread of its own: none may be running when the workers are forked.
    # Lines sent to a file must not be caught by the bar.
    with Progress(
        *columns,
        console=screen,
        transient=True,
        auto_refresh=False,
        disable=not screen.is_terminal,
        redirect_stdout=sys.stdout.isatty(),
    ) as bar:
        task = bar.add_task("", total=laps)
        bar.refresh()
        yield lambda: bar.update(task, advance=1, refresh=True)


def _make_folder(path: Path) -> None:
    try:
        path.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise LapError(f"{path}: is a file; with --count it must be a folder") from None
    except OSError as error:
        raise LapError(f"{path}: cannot be made: {error.strerror}") from None


@app.command()
def convert(
    source: Annotated[Path, typer.Argument(metavar="IN", help="Lap file to read.")],
    out: Annotated[
        Path, typer.Argument(metavar="OUT", help="Lap file to write; its suffix says the format.")
    ],
    map_file: Map = None,
    repair: Repair = False,
) -> None:
    """Write a lap in another format."""
    from bench.laps.files import check_writable, write_lap

    check_writable(out)
    write_lap(open_lap(source, map_file, repair), out)


app.command()(lap_show.show)
app.command()(lap_compare.compare)
