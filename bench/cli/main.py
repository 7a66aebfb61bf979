"""The `bench` command: gathers the commands and turns errors into one line and exit code 2."""

import sys

import typer

from bench.cli import (
    bus,
    calibrate,
    campaign,
    demo,
    doctor,
    ecu,
    fault,
    faults,
    firmware,
    lap,
    mcu,
    monitor,
    plant,
    replay,
    run,
    train,
)
from bench.cli.lean import lean_can
from bench.errors import BenchError
from targets.errors import TargetError

app = typer.Typer(
    name="bench",
    help="Hardware-in-the-loop bench in software for motorcycle suspension ECUs.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
app.command()(demo.demo)
app.command()(run.run)
app.add_typer(lap.app, name="lap")
app.add_typer(plant.app, name="plant")
app.add_typer(campaign.app, name="campaign")
app.add_typer(faults.app, name="faults")
app.add_typer(train.app, name="train")
app.add_typer(calibrate.app, name="calibrate")
app.add_typer(firmware.app, name="firmware")
app.add_typer(mcu.app, name="mcu")
app.command()(replay.replay)
app.add_typer(fault.app, name="fault")
app.command()(ecu.ecu)
app.command()(bus.bus)
app.command()(monitor.monitor)
app.command()(doctor.doctor)


def main() -> None:
    """Entry point of the `bench` command."""
    lean_can()
    try:
        app()
    except (BenchError, TargetError) as error:
        sys.exit(_refuse(error.side, str(error)))
    except OSError as error:
        # What no room has put into words: a path the system will not even look at, a disk that is full.
        name = f"{error.filename}: " if error.filename else ""
        sys.exit(_refuse("system", f"{name}{error.strerror or error}"))


def _refuse(side: str, reason: str) -> int:
    print(f"bench: {side}: {' '.join(reason.split())}", file=sys.stderr)
    return 2


if __name__ == "__main__":
    main()
