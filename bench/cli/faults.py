"""`bench faults`: the fault catalogue, as a table, and each kind with a picture of what it does.

Belongs here: the commands. Never: a kind, a trace; those are in `bench.faults`.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bench.cli.options import json_of, write_json

if TYPE_CHECKING:
    from bench.faults.example import Example

app = typer.Typer(
    help="The fault catalogue: every kind, and what it does.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)


@app.command(name="list")
def list_kinds(
    json_out: Annotated[Path | None, json_of("the catalogue")] = None,
) -> None:
    """Print every fault kind: where it acts, its parameters, failure type byte and name in the thesis."""
    from rich.console import Console
    from rich.table import Table

    from bench.faults.catalogue import catalogue, parameter_text, where_text
    from bench.faults.kinds import KINDS
    from bench.whole import check_writable

    if json_out:
        check_writable(json_out)
    rows = catalogue()
    write_json(json_out, rows)
    table = Table(box=None, pad_edge=False)
    for head in ("kind", "acts on a", "parameters: default (range)", "FTB", "in the thesis"):
        table.add_column(head, no_wrap=head == "kind", overflow="fold")
    for row in rows:
        table.add_row(
            row["kind"],
            where_text(KINDS[row["kind"]]),
            "\n".join(map(parameter_text, row["parameters"])),
            _byte(row),
            row["thesis"] or "",
        )
    console = Console()
    console.print(table, highlight=False, markup=False)
    console.print("\n* not confirmed. bench faults explain KIND tells more.", highlight=False, markup=False)


@app.command()
def explain(
    kind: Annotated[
        str, typer.Argument(metavar="KIND[:PARAM=VALUE,...]", help="As it is written in a fault.")
    ],
    on: Annotated[
        str | None,
        typer.Option("--on", metavar="PLACE", help="A sensor, a message, or bus."),
    ] = None,
    html: Annotated[
        Path | None,
        typer.Option(
            "--html", metavar="OUT", help="Write a page of its own, which needs no network (.html)."
        ),
    ] = None,
    ascii_only: Annotated[
        bool, typer.Option("--ascii", help="Draw without braille, as where the output cannot carry it.")
    ] = False,
) -> None:
    """Print what a fault kind does, and draw a short ride without and with it."""
    from bench.faults.example import example

    if html:
        from bench.cli.page import check_target

        check_target(html, [])
    shown = example(kind, on)
    lines = _lines(shown)
    if html:
        from bench.cli.faults_page import fault_page
        from bench.cli.page import write_page

        write_page(html, fault_page(shown, lines))

    from rich.console import Console

    from bench.cli import draw

    console, style = Console(), draw.style_for(ascii_only)
    drawn = draw.curves(shown.t_s, shown.traces, 1.0, console.width, style, 5)
    for line in [*(draw.plain(line) for line in lines), "", *drawn]:
        console.print(line, markup=False, highlight=False, soft_wrap=True)


def _lines(shown: Example) -> list[str]:
    from bench.faults.catalogue import parameter_text, row
    from bench.faults.ftb import FTB

    spec = shown.spec
    about = row(spec.kind)
    byte = spec.ftb
    lines = [
        f"{spec}",
        f"{spec.kind}: {about['about']}.",
        f"Acts on: {', '.join(about['places'])}.",
        *(f"Parameter {parameter_text(each)}" for each in about["parameters"]),
        "Failure type (SAE J2012-DA): "
        + ("none fits." if byte is None else f"0x{byte:02X}, {FTB[byte].text}{_unsure(byte)}."),
        f"An alarm should name it: {spec.called or 'anything'}.",
    ]
    return [*lines, f"In the thesis: {about['thesis']}."] if about["thesis"] else lines


def _unsure(byte: int) -> str:
    from bench.faults.ftb import FTB

    return "" if FTB[byte].sure else " (not confirmed)"


def _byte(row: dict[str, Any]) -> str:
    found = row["failure_type"]
    return "-" if found is None else f"{found['byte']}{'' if found['confirmed'] else '*'}"
