"""`bench doctor`: what this machine can do, and the command that mends what it cannot."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, NamedTuple

import typer

from bench.cli import doctor_probes as probes
from bench.cli.options import json_of, write_json


class Check(NamedTuple):
    """One ability: what it is for, how it is now ('' if it is missing), and what would mend it."""

    what: str
    found: str
    remedy: str

    def document(self) -> dict[str, str | bool | None]:
        """For JSON: the remedy only where something is missing."""
        return {
            "what": self.what,
            "ok": bool(self.found),
            "found": self.found or None,
            "to_mend": None if self.found else self.remedy,
        }


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


def _receive_buffer() -> str:
    from bench.bus.live import RECEIVE_BUFFER

    return probes.receive_buffer(RECEIVE_BUFFER)


CHECKS: tuple[tuple[str, Callable[[], str], str], ...] = (
    ("emulated STM32F405", _mcu, "install strokebench again"),
    ("host core", _host, "install a C compiler (apt-get install gcc libc6-dev), then strokebench again"),
    (
        "kernel CAN",
        probes.kernel_can,
        "modprobe can-raw, as root; a kernel without it: --bus strokebench, udp_multicast or virtual",
    ),
    (
        "vcan driver",
        probes.vcan_module,
        "modprobe vcan, as root (Debian's cloud kernels lack it: apt-get install linux-image-amd64; "
        "Ubuntu: apt-get install linux-modules-extra-$(uname -r))",
    ),
    (
        "live CAN interface",
        probes.interfaces,
        "ip link add dev vcan0 type vcan && ip link set up vcan0, as root",
    ),
    ("right to create interfaces", probes.rights, "sudo -s (only for ip link; the bench itself needs none)"),
    (
        "receive queue",
        _receive_buffer,
        "sysctl -w net.core.rmem_max=2097152, as root",
    ),
    (
        "clock for 1 kHz",
        probes.clock,
        "chrt -f 50 bench replay ..., as root, or fewer processes beside it",
    ),
    ("python-can interfaces", probes.can_interfaces, "pip install python-can"),
    ("training (torch)", lambda: _package("torch"), "pip install 'strokebench[train]'"),
    (
        "GPU for training",
        probes.gpu,
        "none is needed; with one: apt-get install nvidia-driver, pip install torch (a CUDA build)",
    ),
    (".mf4 recordings (asammdf)", lambda: _package("asammdf"), "pip install 'strokebench[mdf]'"),
    ("MAVLink .tlog (pymavlink)", lambda: _package("pymavlink"), "pip install 'strokebench[mavlink]'"),
    ("HTML pages (plotly)", lambda: _package("plotly"), "pip install 'strokebench[report]'"),
    ("host C compiler", lambda: probes.tool("cc", "gcc", "clang"), "apt-get install gcc libc6-dev"),
    (
        "building firmware",
        lambda: probes.tool("arm-none-eabi-gcc"),
        "apt-get install gcc-arm-none-eabi",
    ),
    ("debugging firmware", lambda: probes.tool("gdb-multiarch"), "apt-get install gdb-multiarch"),
    (
        "comparing with QEMU",
        lambda: probes.tool("qemu-system-arm"),
        "apt-get install qemu-system-arm",
    ),
)


def doctor(json_out: Annotated[Path | None, json_of("what was found")] = None) -> None:
    """Say what this machine can do, and how to mend what it cannot. Exit code 1 if the emulator fails."""
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    if json_out:
        from bench.whole import check_writable

        check_writable(json_out)
    table = Table(box=None, pad_edge=False, show_header=False)
    broken = False
    checks = []
    for what, look, remedy in CHECKS:
        try:
            check = Check(what, look(), remedy)
        except probes.LackError as lack:
            check = Check(what, "", f"{remedy} ({lack})")
        except Exception as error:  # whatever it is, the doctor reports it and goes on
            check = Check(what, "", f"{remedy} ({type(error).__name__}: {error})")
        mark = "[green]yes[/]" if check.found else "[yellow]no[/]"
        table.add_row(mark, check.what, escape(check.found or f"to mend: {check.remedy}"))
        broken |= not check.found and look is _mcu
        checks.append(check)
    Console().print(table, highlight=False)
    write_json(json_out, [check.document() for check in checks])
    if broken:
        raise typer.Exit(1)
