"""`bench plant`: what the simulated motorcycle and road are worth, measured.

Belongs here: the tables. Never: a measure; those are in `bench.plant` and `bench.laps.describe`.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from bench.laps.lap import Lap
    from bench.plant.motorcycle import Motorcycle

app = typer.Typer(
    help="The simulated motorcycle and road.", no_args_is_help=True, pretty_exceptions_enable=False
)


@app.callback()
def _plant() -> None:
    """Keep `check` a command of its own while it is the only one."""


@app.command()
def check(
    motorcycle: Annotated[
        list[str] | None,
        typer.Option(help="A motorcycle's name or .toml file; all shipped ones if left out."),
    ] = None,
    route: Annotated[str, typer.Option(help="Route of the laps that are measured.")] = "test_lap",
    seed: Annotated[int, typer.Option(help="Draws the roads and the laps.")] = 0,
) -> None:
    """Measure the plant: road classes, modes, sag, dive, convergence, stroke speeds, spectra, delays."""
    from rich.console import Console

    from bench.plant.motorcycle import NAMES, load_motorcycle
    from bench.plant.ride import ride
    from bench.plant.route import load_route

    chosen = load_route(route)
    machines = {name: load_motorcycle(name) for name in motorcycle or NAMES}
    screen = Console()
    _roads(screen, seed)
    _modes(screen, machines)
    _attitudes(screen, machines)
    laps = {name: ride(chosen, machine, seed) for name, machine in machines.items()}
    finer = {name: ride(chosen, machine, seed, substeps=4) for name, machine in machines.items()}
    _convergence(screen, laps, finer)
    _speeds(screen, laps)
    _spectra(screen, laps)
    _delays(screen, laps, machines)


def _table(title: str, *columns: str) -> Table:
    from rich.table import Table

    table = Table(title=title, title_justify="left", box=None, pad_edge=False, padding=(0, 2, 0, 0))
    for k, name in enumerate(columns):
        table.add_column(name, justify="left" if k == 0 else "right", no_wrap=True)
    return table


def _roads(screen: Console, seed: int) -> None:
    from bench.plant.road.classes import class_table
    from bench.plant.road.surface import SURFACES

    table = _table(
        "Roads: 5 km of each drawn and measured, smoothed as ISO 8608 does, 0.011-2.83 cycles/m",
        "surface", "class", "Gd(0.1) 1e-6 m3", "limits", "slope", "bands inside",
    )  # fmt: skip
    for row in class_table(SURFACES, seed=seed):
        table.add_row(
            row.surface,
            row.iso,
            f"{1e6 * row.level_m3:.4g}",
            f"{1e6 * row.lower_m3:.4g}-{1e6 * row.upper_m3:.4g}",
            f"{row.slope:.2f}",
            f"{100 * row.inside:.0f} %",
        )
    screen.print(table, "")


def _modes(screen: Console, machines: dict[str, Motorcycle]) -> None:
    from bench.plant.modes import identified, modes, without_seals

    table = _table(
        "Modes without seal friction: of the equations linearised at rest, and of the simulated motion",
        "motorcycle", "mode", "Hz", "simulated", "damping", "simulated",
    )  # fmt: skip
    for name, machine in machines.items():
        free = without_seals(machine)
        for mine, seen in zip(modes(free), identified(free), strict=True):
            table.add_row(
                name,
                mine.name,
                f"{mine.hz:.2f}",
                f"{seen.hz:.2f}",
                f"{mine.damping:.3f}",
                f"{seen.damping:.3f}",
            )
    screen.print(table, "")


def _attitudes(screen: Console, machines: dict[str, Motorcycle]) -> None:
    from bench.plant.modes import attitude, one_g

    table = _table(
        "Static sag, and 1 g of braking held until it settles",
        "motorcycle", "fork mm", "rear mm", "at 1 g", "", "pitch deg", "rear tyre N",
    )  # fmt: skip
    for name, machine in machines.items():
        rest, braking = attitude(machine), one_g(machine)
        table.add_row(
            name,
            f"{rest.fork_mm:.1f}",
            f"{rest.rear_mm:.1f}",
            f"{braking.fork_mm:.1f}",
            f"{braking.rear_mm:.1f}",
            f"{braking.pitch_deg - rest.pitch_deg:+.2f}",
            f"{rest.rear_n:.0f} to {braking.rear_n:.0f}",
        )
    screen.print(table, "")


def _convergence(screen: Console, laps: dict[str, Lap], finer: dict[str, Lap]) -> None:
    import numpy as np

    from bench.laps.describe import STROKES

    table = _table(
        "Convergence: rms of what halving the integrator's step of 0.5 ms changes in a lap, mm",
        "motorcycle", "fork", "rear", "of a spread of", "",
    )  # fmt: skip
    for name, lap in laps.items():
        moved = [
            float(np.sqrt(np.mean((lap.channels[stroke] - finer[name].channels[stroke]) ** 2)))
            for stroke in STROKES
        ]
        table.add_row(
            name,
            *(f"{rms:.4f}" for rms in moved),
            *(f"{lap.channels[stroke].std():.2f}" for stroke in STROKES),
        )
    screen.print(table, "")


def _speeds(screen: Console, laps: dict[str, Lap]) -> None:
    from bench.laps.describe import CLASSES_MM_S, shares, stroke_speed

    table = _table("Fork stroke speed: share of samples in each class (figure IV.14), %", "mm/s", *laps)
    counts = [shares(stroke_speed(lap, "fork_stroke_mm")) for lap in laps.values()]
    for k, (low, high) in enumerate(pairwise((*CLASSES_MM_S, None))):
        label = f"{low:.0f}-{high:.0f}" if high else f"over {low:.0f}"
        table.add_row(label, *(f"{100 * count[k]:.2f}" for count in counts))
    under = [100 * count[: CLASSES_MM_S.index(400.0)].sum() for count in counts]
    table.add_row("under 400", *(f"{share:.2f}" for share in under))
    screen.print(table, "")


def _spectra(screen: Console, laps: dict[str, Lap]) -> None:
    import numpy as np

    from bench.laps.describe import spectrum, stroke_speed

    table = _table(
        "Share of the power within 1-10 Hz (section IV.2, figure IV.3), and within 1-20 Hz, %", "", *laps
    )
    rows: dict[str, list[str]] = {}
    for lap in laps.values():
        speed = stroke_speed(lap, "fork_stroke_mm")
        signals = {
            "fork stroke": lap.channels["fork_stroke_mm"],
            "its speed": speed,
            "its acceleration": np.gradient(speed, 0.001),
            "acc_body (steering head)": lap.channels["acc_body_ms2"],
            "acc_front (wheel)": lap.channels["acc_front_ms2"],
        }
        for row, values in signals.items():
            f, density = spectrum(lap, values)
            inside = [density[(f >= 1.0) & (f <= top)].sum() / density[f > 0.0].sum() for top in (10.0, 20.0)]
            rows.setdefault(row, []).append(" / ".join(f"{100 * share:.0f}" for share in inside))
    for row, cells in rows.items():
        table.add_row(row, *cells)
    screen.print(table, "")


def _delays(screen: Console, laps: dict[str, Lap], machines: dict[str, Motorcycle]) -> None:
    from bench.laps.describe import delay

    table = _table(
        "The rear follows the front: delay between the strokes' speeds times speed, in windows of 5 s",
        "motorcycle", "median ms", "m", "wheelbase m", "windows",
    )  # fmt: skip
    for name, lap in laps.items():
        found = delay(lap)
        table.add_row(
            name,
            f"{1e3 * found.median_s:.0f}",
            f"{found.base_m:.3f}",
            f"{machines[name].wheelbase_m:.3f}",
            f"{found.windows} of {found.of}",
        )
    screen.print(table)
