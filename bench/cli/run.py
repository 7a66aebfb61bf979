"""`bench run`: one lap, one verdict."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bench.cli.options import (
    Bitrate,
    EcuName,
    Elf,
    Faults,
    Host,
    Map,
    Model,
    Rate,
    Repair,
    SensorSeed,
    SensorsName,
    build_ecu,
    json_of,
    open_lap,
    write_json,
)

if TYPE_CHECKING:
    from bench.run import Run
    from targets.ecus import Build


def run(
    lap: Annotated[Path, typer.Argument(metavar="LAP", help="Lap file or recording.")],
    fault: Faults = None,
    ecu: EcuName = "ifd",
    on: Host = "mcu",
    model: Model = None,
    elf: Elf = None,
    sensors: SensorsName = "datasheet",
    seed: SensorSeed = 0,
    map_file: Map = None,
    repair: Repair = False,
    rate: Rate = None,
    bitrate: Bitrate = 500_000,
    json_out: Annotated[Path | None, json_of("the result")] = None,
    record_out: Annotated[
        Path | None,
        typer.Option("--record", metavar="OUT", help="Record the bus (.log, .asc, .blf, .mf4)."),
    ] = None,
) -> None:
    """Replay a lap through sensors, faults, logger, timed bus and ECU, and judge what the ECU said.

    Exit code 0: a fault was found, or there was none and no alarm. 1: any other verdict. 2: bad input.
    """
    from bench.codec import Codec
    from bench.faults.spec import parse_fault
    from bench.mdlog.events import noted
    from bench.recorder import check_target, record
    from bench.run import document, run_lap
    from bench.sensors.datasheets import load_sensors
    from bench.whole import check_writable

    if json_out:
        check_writable(json_out)
    if record_out:
        check_target(record_out)
    specs = [parse_fault(text) for text in fault or []]
    build = build_ecu(ecu, on, model, elf)
    instruments = load_sensors(sensors)
    ride_of = open_lap(lap, map_file, repair)

    with _progress(ride_of.duration_ns) as tell:
        device = build.power_on()
        done = run_lap(
            ride_of,
            device,
            specs,
            build.needs(),
            progress=tell,
            sensors=instruments,
            seed=seed,
            rate_hz=rate,
            bitrate=bitrate,
        )

    result = document(done)
    result["unmodelled_accesses"] = _unmodelled(device)
    result["provenance"] = _provenance(build, lap, ride_of.digest(), sensors, seed)
    if record_out:
        rows = [(d.t_end_ns, d.frame, d.node) for d in done.ride.frames]
        record(record_out, noted(rows, done.insertions, Codec()))
    write_json(json_out, result)
    _print(done, result, device)
    if not done.verdict.outcome.passed:
        raise typer.Exit(1)


def _progress(duration_ns: int) -> Any:
    from bench.cli.progress import lap_progress

    return lap_progress(duration_ns)


def _unmodelled(device: Any) -> dict[str, int]:
    mcu = getattr(device, "mcu", None)
    return {f"{address:#010x}": count for address, count in mcu.unmodelled().items()} if mcu else {}


def _provenance(build: "Build", lap: Path, digest: str, sensors: str, seed: int) -> dict[str, Any]:
    from bench.provenance import versions

    trained = build.calibration.provenance.get("seed")
    return {
        "versions": versions(),
        "lap": lap.name,
        "lap_sha256": digest,
        **build.provenance(),
        "sensors": sensors,
        # The other seeds that matter made the lap (unknown here) and the network.
        "seed": {"sensors": seed, "calibration": trained},
    }


def _print(done: "Run", result: dict[str, Any], device: Any) -> None:
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    verdict, colour = done.verdict, "green" if done.verdict.outcome.passed else "red"
    console = Console()
    reason = escape(verdict.reason)
    console.print(f"[bold {colour}]{verdict.outcome}[/]  {reason}", highlight=False, soft_wrap=True)
    table = Table(box=None, show_header=False, pad_edge=False)
    for name in ("t_cmd_s", "t_active_s", "t_obs_s", "t_alarm_s", "t_heal_s", "td_s"):
        if result[name] is not None:
            table.add_row(name, f"{result[name]:.6f}")
    cycles = result["step_cycles"]
    if cycles and cycles["max"]:
        hz = device.mcu.hz
        table.add_row(
            "step",
            f"{cycles['min']} / {cycles['mean']:.0f} / {cycles['max']} cycles (min/mean/max), "
            f"{cycles['mean'] / hz * 1e6:.1f} us mean at {hz / 1e6:g} MHz",
        )
    table.add_row("bus", f"{100 * result['bus']['load']:.1f} % of {result['bus']['bitrate'] // 1000} kbit/s")
    for sensor, count in result["saturated_samples"].items():
        table.add_row("saturated", f"{sensor}: {count} samples beyond its span")
    for address, count in result["unmodelled_accesses"].items():
        table.add_row("unmodelled", f"{address}: {count} accesses")
    console.print(table)
