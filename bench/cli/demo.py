"""`bench demo`: the main job on embedded defaults."""

from typing import Annotated

import typer


def demo(
    workers: Annotated[int | None, typer.Option(help="Processes.  [default: all cores]")] = None,
) -> None:
    """Ride a short road trial, the emulated MCU in every lap, and print its tables beside the thesis's."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    from bench.errors import BenchError
    from campaigns.plan import expand, load
    from campaigns.runner import run, warm_up
    from campaigns.tables import road
    from targets.ecus import build

    if workers is not None and workers < 1:
        raise BenchError(f"--workers is {workers}; it must be at least 1")
    campaign = load("demo")
    trials = expand(campaign)
    ecu = build("ifd", "mcu")
    console, side = Console(), Console(stderr=True)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    )
    # Drawn when a lap is done, not by a thread of its own: none may be running when the workers are forked.
    with Progress(
        *columns, console=side, transient=True, auto_refresh=False, disable=not side.is_terminal
    ) as bar:
        task = bar.add_task("compiling, once", total=None)
        bar.refresh()
        warm_up(trials[0], ecu)
        bar.update(task, description="riding laps", total=len(trials), refresh=True)
        results = run(trials, ecu, workers, lambda _: bar.update(task, advance=1, refresh=True))
    console.print(f"[bold]{campaign.title}[/]: {campaign.stands_for}", highlight=False)
    console.print(
        f"{len(trials)} laps of route {campaign.route}, seeds {trials[0].lap_seed}-{trials[-1].lap_seed}; "
        f"ECU {ecu.role} on the emulated STM32F405, CAN at 500 kbit/s\n",
        highlight=False,
    )
    for part in road(campaign, results):
        console.print(part, highlight=False)
        console.print()
