"""`bench firmware gdb`: the emulated MCU for GDB to connect to. The socket is here, and nowhere else."""

from __future__ import annotations

import select
import socket
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bench.cli.options import EcuName, Faults, Model
from bench.cli.stop import stoppable

if TYPE_CHECKING:
    from collections.abc import Callable

    from bench.gdb.session import Powered, Session
    from bench.mdlog.logger import Schedule
    from targets.ecus import Build

LOOPBACK = "127.0.0.1"


def gdb(
    elf: Annotated[
        Path | None, typer.Argument(metavar="ELF", help="Firmware image.  [default: the shipped one]")
    ] = None,
    ecu: EcuName = "ifd",
    model: Model = None,
    lap: Annotated[
        Path | None,
        typer.Option("--lap", metavar="LAP", help="What the bus carries.  [default: a simulated test lap]"),
    ] = None,
    fault: Faults = None,
    silent: Annotated[bool, typer.Option("--silent", help="No lap: nobody else speaks on the bus.")] = False,
    port: Annotated[int, typer.Option(min=0, max=65535, help="TCP port, 0: any free one.")] = 3333,
    host: Annotated[str, typer.Option(help="Address to listen on; who reaches it owns the ECU.")] = LOOPBACK,
) -> None:
    """Let GDB debug a firmware on the emulated STM32F405: halted in reset, in virtual time.

    One debugger is served; when it leaves, the command ends. A firmware that takes this bench's calibration
    hears a lap on the bus, any other one hears nothing unless --lap is given. Commands of GDB's `monitor`:
    time, cycles, can, unmodelled, frames, reset.
    """
    from bench.cli.options import build_ecu
    from bench.gdb.session import Session
    from targets.emulated import ROOM_SYMBOL

    build = build_ecu(ecu, "mcu", model, elf)
    own = ROOM_SYMBOL in build.image.symbols
    frames = _lap_frames(build, lap, fault or []) if not silent and (own or lap) else None
    power_on = _powering(build, own or model is not None)
    power_on()  # what cannot start is refused before anyone connects
    with stoppable():
        try:
            with _accept(host, port, _command(elf, build.image.source)) as connection:
                _live(Session(power_on, _Socket(connection)), frames, ecu)
        except KeyboardInterrupt:
            return
    typer.echo("the debugger has left", err=True)


def _powering(build: Build, calibrated: bool) -> Callable[[], Powered]:
    """What puts an ECU in reset; the flash is the last one's, with what a debugger has loaded into it."""
    from bench.gdb.session import Powered
    from targets.emulated import EmulatedEcu
    from targets.mcu.debugger import Debugger

    flash = None

    def power_on() -> Powered:
        nonlocal flash
        ecu = EmulatedEcu(build.image, build.calibration if calibrated else None, build.role)
        if flash is not None:
            ecu.mcu.flash[:] = flash
        flash = ecu.mcu.flash
        return Powered(ecu, Debugger(ecu.mcu))

    return power_on


def _lap_frames(build: Build, lap: Path | None, faults: list[str]) -> Schedule:
    """The frames of `lap`, or of a simulated one."""
    from bench.cli.options import open_lap
    from bench.codec import Codec
    from bench.faults.spec import parse_fault
    from bench.plant.motorcycle import load_motorcycle
    from bench.plant.ride import ride
    from bench.plant.route import load_route
    from bench.run import prepare
    from bench.sensors.datasheets import load_sensors

    specs = [parse_fault(text) for text in faults]
    ridden = open_lap(lap, None, False) if lap else ride(load_route("test_lap"), load_motorcycle(), 0)
    return prepare(ridden, specs, (), build.role, Codec(), load_sensors("datasheet")).now.frames


def _command(elf: Path | None, source: str) -> str:
    """GDB's command line; the shipped image's source files are named from their folder on."""
    from targets.firmware import HERE

    return f"gdb-multiarch {source}" if elf else f"gdb-multiarch -d {HERE} {source}"


def _accept(host: str, port: int, command: str) -> socket.socket:
    """The connection of the first debugger that comes; nobody else can connect after it."""
    from bench.errors import DebuggerError

    try:
        server = socket.create_server((host, port), backlog=0)
    except OSError as error:
        raise DebuggerError(f"{host}:{port}: {(error.strerror or str(error)).lower()}") from None
    with server:
        place = f"{host if host != LOOPBACK else ''}:{server.getsockname()[1]}"
        typer.echo(f"halted in reset; connect with: {command} -ex 'target remote {place}'", err=True)
        connection, _ = server.accept()
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return connection


def _live(session: Session, frames: Schedule | None, role: str) -> None:
    """The ECU's lives, one after each reset: first the lap, then silence, until the debugger leaves."""
    from bench.codec import Codec
    from bench.gdb.session import Left, Onlooker, PowerCycle, silent_bus
    from bench.rig import ride

    while True:
        end_ns = 0
        try:
            if frames is not None:
                done = ride(frames, session, Onlooker(Codec(), role))
                end_ns = done.end_ns
                typer.echo(f"the lap is over at {end_ns / 1e9:.3f} s {done.failure or ''}".strip(), err=True)
            silent_bus(session, end_ns)
        except PowerCycle:
            session.power_cycle()
        except Left:
            return


class _Socket:
    """The `Line` of a session over TCP."""

    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection

    def receive(self, wait: bool) -> bytes:
        from bench.gdb.session import Left

        if not wait and not select.select([self._connection], [], [], 0)[0]:
            return b""
        try:
            data = self._connection.recv(0x10000)
        except OSError:
            raise Left from None
        if not data:
            raise Left
        return data

    def send(self, data: bytes) -> None:
        from bench.gdb.session import Left

        try:
            self._connection.sendall(data)
        except OSError:
            raise Left from None
