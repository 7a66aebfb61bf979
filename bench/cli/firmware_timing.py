"""`bench firmware timing`: Table V.13 measured on the emulated MCU, beside the thesis's.

Belongs here: options, tables, the page. Never: a measurement; those are in `campaigns.timing`.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from bench.cli.options import Model, SensorSeed

if TYPE_CHECKING:
    from rich.console import Console

    from targets.profile import Profile

_LINES, _FUNCTIONS = 20, 12
_WORDS = ("code", "function", "line", "practice")
"""Heads of columns that are cut short where the terminal is narrow."""


class Sheet(NamedTuple):
    """A table: its title, the heads of its columns, its rows."""

    title: str
    heads: Sequence[str]
    rows: Sequence[Sequence[str]]


def timing(
    repeat: Annotated[int, typer.Option(min=1, help="Steps of each code that are timed.")] = 1000,
    clock: Annotated[
        list[float] | None,
        typer.Option(metavar="MHZ", help="CPU clock; may be given more than once.  [default: 22, 84, 168]"),
    ] = None,
    code: Annotated[
        list[str] | None,
        typer.Option(help="initial, compiler or final; may be given more than once.  [default: all]"),
    ] = None,
    each: Annotated[
        bool, typer.Option("--each", help="Time each practice by itself, too (needs the compiler).")
    ] = False,
    model: Model = None,
    seed: SensorSeed = 0,
    json_out: Annotated[
        Path | None, typer.Option("--json", metavar="OUT", help="Write the figures as JSON.")
    ] = None,
    html_out: Annotated[
        Path | None, typer.Option("--html", metavar="OUT", help="Write a page with the tables, drawn.")
    ] = None,
) -> None:
    """Time the IFD's step between two edges of its pin, over a simulated lap (STEPS 2 to 4, Table V.13)."""
    from rich.console import Console

    from bench.cli.page import check_target, write_page
    from bench.errors import RecordError
    from bench.plant.motorcycle import load_motorcycle
    from bench.plant.ride import ride
    from bench.plant.route import load_route
    from bench.sensors.datasheets import load_sensors
    from bench.whole import check_writable, whole
    from campaigns import timing as measured
    from targets.ecus import build
    from targets.errors import FirmwareError
    from targets.firmware.clock import setting

    unknown = [name for name in code or () if name not in measured.CODES]
    if unknown:
        raise FirmwareError(f"no code {unknown[0]}; there are {', '.join(measured.CODES)}")
    clocks_hz = [round(mhz * 1e6) for mhz in clock] if clock else list(measured.CLOCKS_HZ)
    for hz in clocks_hz:
        setting(hz)
    if json_out:
        check_writable(json_out, RecordError)
    if html_out:
        check_target(html_out, [])
    base = build("ifd", "mcu", model)
    lap = ride(load_route("test_lap"), load_motorcycle(), seed)
    frames = measured.frames_of(lap, base, load_sensors("datasheet"), repeat + 1)
    screen = Console()
    names = [name for name in measured.CODES if not code or name in code]
    timed = list(measured.codes(frames, base, clocks_hz, names))
    final = next((steps for steps in timed if steps.code == "final"), timed[-1])
    own = next(one for one in measured.builds(base, [final.code]))
    lowest = measured.lowest_clock(frames, own, final)
    counted = measured.profile(frames, own)
    result: dict[str, Any] = {
        "times": [steps.document() for steps in timed],
        "memory": [measured.memory(steps, base) for steps in timed if steps.hz == clocks_hz[0]],
        "lowest_clock": measured.lowest_document(final.code, lowest),
        "profile": _profile(final.code, counted),
        "each": measured.ladder(frames, base) if each else [],
    }
    sheets = _sheets(result, repeat)
    for sheet in sheets:
        _print(screen, sheet)
    if json_out:
        with whole(json_out) as part:
            part.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    if html_out:
        write_page(html_out, _page(sheets, result))


def _profile(code: str, counted: Profile) -> dict[str, Any]:
    from targets.firmware import HERE

    lines = []
    for place, cycles in counted.by_line()[:_LINES]:
        name, _, number = place.rpartition(":")
        source = HERE / name
        texts = source.read_text(encoding="utf-8").splitlines() if name and source.is_file() else []
        text = texts[int(number) - 1].strip() if texts else ""
        # Libraries were compiled in folders of their own: ../../libgcc/config/arm/ieee754-sf.S
        shown = "/".join(part for part in place.split("/") if part != "..")
        lines.append({"line": shown, "cycles": cycles, "text": text})
    functions = [{"function": name, "cycles": cycles} for name, cycles in counted.by_function()]
    return {"code": code, "cycles": counted.total, "functions": functions, "lines": lines}


def _sheets(result: dict[str, Any], repeat: int) -> list[Sheet]:
    found = [_times(result["times"], repeat), _memory(result["memory"]), _lowest(result["lowest_clock"])]
    profile = result["profile"]
    for what, count in (("function", _FUNCTIONS), ("line", _LINES)):
        found.append(
            Sheet(
                f"Where a step of the {profile['code']} code spends its {profile['cycles']:.0f} cycles",
                ("cycles", "%", what),
                [
                    (
                        f"{row['cycles']:.0f}",
                        f"{100 * row['cycles'] / profile['cycles']:.1f}",
                        f"{row[what]}  {row.get('text', '')}".rstrip(),
                    )
                    for row in profile[f"{what}s"][:count]
                ],
            )
        )
    if result["each"]:
        found.append(_each(result["each"]))
    return found


def _times(rows: list[dict[str, Any]], repeat: int) -> Sheet:
    return Sheet(
        f"Table V.13: a step of the IFD between two edges of PA0, {repeat} of them, us. "
        "The three clocks are our reading of its rows.",
        ("MHz", "code", "mean, sigma", "range", "best-worst", "NARX", "thesis"),
        [
            (
                f"{row['clock_mhz']:g}",
                row["code"],
                f"{row['mean_us']:.4g} {row['std_us']:5.2f}",
                f"{row['min_us']:.4g}-{row['max_us']:.4g}",
                "{:.4g}-{:.4g}".format(*row["bounds_us"]) if row["bounds_us"] else "-",
                f"{row['narx_mean_us']:.4g}",
                f"{row['thesis_mean_us']:.1f} {row['thesis_std_us']:.1f}" if row["thesis_mean_us"] else "-",
            )
            for row in rows
        ],
    )


def _memory(rows: list[dict[str, Any]]) -> Sheet:
    return Sheet(
        "Table V.13: memory, kB (1024 bytes)",
        ("code", "flash", "program", "weights", "RAM", "variables", "stack", "thesis:", "RAM"),
        [
            (
                row["code"],
                *(
                    f"{row[f'{name}_bytes'] / 1024:.1f}"
                    for name in ("flash", "program", "calibration", "ram", "variables", "stack")
                ),
                f"flash {row['thesis_flash_kB']}",
                f"{row['thesis_ram_kB']}",
            )
            for row in rows
        ],
    )


def _lowest(row: dict[str, Any]) -> Sheet:
    mhz = "none" if row["clock_mhz"] is None else f"{row['clock_mhz']:g}"
    slowest = "-" if row["slowest_us"] is None else f"{row['slowest_us']:.1f}"
    return Sheet(
        f"Lowest clock at which every step leaves {100 * row['margin']:.0f} % of {row['limit_us']:g} us",
        ("code", "MHz", "slowest step, us", "thesis, MHz"),
        [(row["code"], mhz, slowest, f"{row['thesis_clock_mhz']:g}")],
    )


def _each(rows: list[dict[str, Any]]) -> Sheet:
    return Sheet(
        "Each practice on top of those above it, at 22 MHz",
        ("us a step", "of the initial", "flash, kB", "RAM, kB", "practice"),
        [
            (
                f"{row['mean_us']:.4g}",
                f"{row['mean_us'] / rows[0]['mean_us']:.3f}",
                f"{row['program_bytes'] / 1024:.1f}",
                f"{row['variables_bytes'] / 1024:.1f}",
                row["says"],
            )
            for row in rows
        ],
    )


def _print(screen: Console, sheet: Sheet) -> None:
    from rich.table import Table

    screen.print(sheet.title, highlight=False, markup=False, soft_wrap=True)
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    for head, *cells in zip(sheet.heads, *sheet.rows, strict=True):
        if head in _WORDS:
            table.add_column(head, no_wrap=True)
        else:
            table.add_column(head, justify="right", no_wrap=True, min_width=max(map(len, (head, *cells))))
    for row in sheet.rows:
        table.add_row(*row)
    screen.print(table, "", highlight=False, markup=False)


def _page(sheets: list[Sheet], result: dict[str, Any]) -> str:
    from plotly.graph_objects import Bar

    from bench.cli.page import frame, plot, subplots, table

    figure = subplots(["us a step (Table V.13)", "cycles a step by source line"], 1, 420, 140)
    labels = [f"{row['code']}, {row['clock_mhz']:g} MHz" for row in result["times"]]
    for name, key in (("emulated", "mean_us"), ("thesis", "thesis_mean_us")):
        figure.add_trace(Bar(x=labels, y=[row[key] for row in result["times"]], name=name), row=1, col=1)
    lines = result["profile"]["lines"]
    figure.add_trace(
        Bar(
            x=[row["line"] for row in lines],
            y=[row["cycles"] for row in lines],
            text=[row["text"] for row in lines],
            textposition="none",
            showlegend=False,
        ),
        row=2,
        col=1,
    )
    body = []
    for sheet in sheets:
        body += [f"<h2>{sheet.title}</h2>", table(sheet.heads, sheet.rows)]
    return frame("Firmware timing", [*body, plot(figure)])
