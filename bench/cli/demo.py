"""`bench demo`: the main job on embedded defaults."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from campaigns.plan import Campaign


def demo(
    workers: Annotated[int | None, typer.Option(help="Processes.  [default: all cores]")] = None,
) -> None:
    """Ride a short road trial, the emulated MCU in every lap, and print its tables beside the thesis's."""
    from bench.errors import BenchError
    from campaigns.plan import Campaign, load

    if workers is not None and workers < 1:
        raise BenchError(f"--workers is {workers}; it must be at least 1")
    campaign = load("demo")
    assert isinstance(campaign, Campaign)
    road(campaign, workers)


def road(campaign: Campaign, workers: int | None) -> None:
    """Run a road trial and print its tables."""
    from rich.console import Console

    from bench.cli.progress import counted_progress
    from campaigns.plan import expand
    from campaigns.runner import run, warm_up
    from campaigns.tables import road as tables
    from targets.ecus import build

    trials = expand(campaign)
    ecu = build("ifd", "mcu")
    with counted_progress("compiling, once", None):
        warm_up(trials[0], ecu)
    with counted_progress("riding laps", len(trials)) as advance:
        results = run(trials, ecu, workers, lambda _: advance(""))
    console = Console()
    console.print(f"[bold]{campaign.title}[/]: {campaign.stands_for}", highlight=False)
    console.print(
        f"{len(trials)} laps of route {campaign.route}, seeds {trials[0].lap_seed}-{trials[-1].lap_seed}; "
        f"ECU {ecu.role} on the emulated STM32F405, CAN at 500 kbit/s\n",
        highlight=False,
    )
    for part in tables(campaign, results):
        console.print(part, highlight=False)
        console.print()
