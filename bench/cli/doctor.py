"""`bench doctor`: what this machine can do, and the command that mends what it cannot."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import typer


class Check(NamedTuple):
    """One ability: what it is for, how it is now ('' if it is missing), and what would mend it."""

    what: str
    found: str
    remedy: str


def _package(name: str) -> str:
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version(name)
    except PackageNotFoundError:
        return ""


def _mcu() -> str:
    from targets.ecus import build

    ecu = build().power_on()
    ecu.advance(0)
    return f"boots the shipped firmware, {ecu.where()}"


def _host() -> str:
    from targets.host import library

    return "built" if library() else ""


def _vcan() -> str:
    links = Path("/sys/class/net")
    names = [link.name for link in links.iterdir() if link.name.startswith(("vcan", "can"))]
    return ", ".join(sorted(names))


def _tool(name: str) -> Callable[[], str]:
    return lambda: shutil.which(name) or ""


CHECKS: tuple[tuple[str, Callable[[], str], str], ...] = (
    ("emulated STM32F405", _mcu, "install strokebench again"),
    ("host core", _host, "install a C compiler (apt-get install gcc libc6-dev), then strokebench again"),
    ("live CAN interface", _vcan, "ip link add dev vcan0 type vcan && ip link set up vcan0, as root"),
    ("training (torch)", lambda: _package("torch"), "pip install 'strokebench[train]'"),
    (".mf4 recordings (asammdf)", lambda: _package("asammdf"), "pip install 'strokebench[mdf]'"),
    ("MAVLink .tlog (pymavlink)", lambda: _package("pymavlink"), "pip install 'strokebench[mavlink]'"),
    ("HTML pages (plotly)", lambda: _package("plotly"), "pip install 'strokebench[report]'"),
    ("building firmware", _tool("arm-none-eabi-gcc"), "apt-get install gcc-arm-none-eabi"),
)


def doctor() -> None:
    """Say what this machine can do, and how to mend what it cannot. Exit code 1 if the emulator fails."""
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    table = Table(box=None, pad_edge=False, show_header=False)
    broken = False
    for what, look, remedy in CHECKS:
        try:
            check = Check(what, look(), remedy)
        except Exception as error:  # whatever it is, the doctor reports it and goes on
            check = Check(what, "", f"{remedy} ({type(error).__name__}: {error})")
        mark = "[green]yes[/]" if check.found else "[yellow]no[/]"
        table.add_row(mark, check.what, escape(check.found or f"to mend: {check.remedy}"))
        broken |= not check.found and look is _mcu
    Console().print(table, highlight=False)
    if broken:
        raise typer.Exit(1)
