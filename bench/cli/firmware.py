"""`bench firmware`: the firmware held to what it implements.

Belongs here: options, the table, the page. Never: what is compared.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bench.cli import firmware_image, firmware_timing, gdb
from bench.cli.options import EcuName, Elf, Map, Model, Repair, SensorSeed, SensorsName

if TYPE_CHECKING:
    from campaigns.validation import Deviation

app = typer.Typer(
    help="The firmware and what it implements.", no_args_is_help=True, pretty_exceptions_enable=False
)

app.command()(firmware_image.build)
app.command()(firmware_image.size)
app.command()(firmware_timing.timing)
app.command()(gdb.gdb)


@app.command()
def validate(
    lap: Annotated[
        Path | None, typer.Argument(metavar="LAP", help="Lap file.  [default: a simulated test lap]")
    ] = None,
    ecu: EcuName = "ifd",
    model: Model = None,
    elf: Elf = None,
    sensors: SensorsName = "datasheet",
    seed: SensorSeed = 0,
    map_file: Map = None,
    repair: Repair = False,
    json_out: Annotated[
        Path | None, typer.Option("--json", metavar="OUT", help="Write the figures as JSON.")
    ] = None,
    html_out: Annotated[
        Path | None, typer.Option("--html", metavar="OUT", help="Write a page with figure V.18.")
    ] = None,
) -> None:
    """Hold the soft sensor on the emulated MCU to torch in double precision over a lap (STEP 5, V.18)."""
    import numpy as np
    from rich.console import Console

    from bench.cli.options import build_ecu, open_lap
    from bench.cli.page import check_target, write_page
    from bench.plant.motorcycle import load_motorcycle
    from bench.plant.ride import ride
    from bench.plant.route import load_route
    from bench.sensors.datasheets import load_sensors
    from bench.whole import check_writable, whole
    from campaigns.thesis import thesis
    from campaigns.validation import validate as compare

    if json_out:
        check_writable(json_out)
    if html_out:
        check_target(html_out, [lap] if lap else [])
    build = build_ecu(ecu, "mcu", model, elf)
    instruments = load_sensors(sensors)
    own = None if lap else ride(load_route("test_lap"), load_motorcycle(), seed)
    ridden = own or open_lap(Path(str(lap)), map_file, repair)
    found = compare(build, ridden, instruments)
    free, step = np.abs(found.percent), np.abs(found.step_percent)
    result: dict[str, Any] = {
        "steps": len(found.t_s),
        "free_run_worst_percent": float(free.max()),
        "free_run_worst_at_s": float(found.t_s[int(free.argmax())]),
        "free_run_worst_mm": float(np.abs(found.firmware_mm - found.reference_mm).max()),
        "free_run_rms_percent": float(np.sqrt(np.mean(free**2))),
        "one_step_worst_percent": float(step.max()),
        "one_step_rms_percent": float(np.sqrt(np.mean(step**2))),
        "thesis_percent": thesis()["firmware"]["max_deviation_percent"],
    }
    console = Console()
    console.print(
        f"{ridden.source}: {len(found.t_s)} steps on the emulated STM32F405 against torch, float64.\n"
        "Largest deviation, in percent of the predicted stroke (thesis: "
        f"{result['thesis_percent']:g}, of what it does not say):\n"
        f"  free run, each fed back with its own  {result['free_run_worst_percent']:.1e}, at "
        f"{result['free_run_worst_at_s']:.2f} s ({result['free_run_worst_mm']:.1e} mm), "
        f"rms {result['free_run_rms_percent']:.1e}\n"
        f"  each step from the firmware's own     {result['one_step_worst_percent']:.1e}, "
        f"rms {result['one_step_rms_percent']:.1e}",
        highlight=False,
        soft_wrap=True,
    )
    _draw(console, found)
    if json_out:
        with whole(json_out) as part:
            part.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    if html_out:
        write_page(html_out, _page(ridden.source, found, result))


def _draw(console: Any, found: Deviation) -> None:
    from bench.cli import draw

    channels = {"free run_1e-6 percent": found.percent * 1e6}
    for line in draw.curves(found.t_s, channels, 0.02, console.width, draw.style_for()):
        console.print(line, highlight=False, markup=False)


def _page(title: str, found: Deviation, result: dict[str, Any]) -> str:
    from plotly.graph_objects import Scatter

    from bench.cli.page import frame, plot, subplots, table

    figure = subplots(["deviation, % of the predicted stroke (figure V.18)", "prediction, mm"], 1, 320, 90)
    for row, (name, values) in enumerate(
        (
            ("deviation", found.percent),
            ("firmware", found.firmware_mm),
            ("torch, float64", found.reference_mm),
        )
    ):
        figure.add_trace(
            Scatter(x=found.t_s, y=values, name=name, mode="lines", line={"width": 1}),
            row=min(row, 1) + 1,
            col=1,
        )
    figure.update_xaxes(title_text="time, s")
    cells = [[name, f"{value:.6g}"] for name, value in result.items()]
    return frame(f"Firmware against reference: {title}", [table(("figure", "value"), cells), plot(figure)])
