"""`bench mcu`: any Cortex-M4 firmware on the emulated STM32F405, a function of it or all of it.

Belongs here: options, what is printed. Never: how a call or a run is done.
"""

from __future__ import annotations

import json
import statistics
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from targets.mcu.call import Outcome

app = typer.Typer(
    help="Any Cortex-M4 firmware: the cycles of a function, or a run from its vector table.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)

MAX_MHZ = 168.0
MAX_WAIT_STATES = 7  # FLASH_ACR.LATENCY has three bits

AnyElf = Annotated[Path, typer.Argument(metavar="ELF", help="A linked ELF file for a Cortex-M4.")]


@app.command(context_settings={"ignore_unknown_options": True})  # -1 is an argument
def call(
    elf: AnyElf,
    symbol: Annotated[str, typer.Argument(metavar="SYMBOL", help="The function to call.")],
    arguments: Annotated[
        list[str] | None,
        typer.Argument(metavar="[ARG]...", help="Integer (12, -1, 0x20000000) or &SYMBOL[+OFFSET]."),
    ] = None,
    clock: Annotated[float, typer.Option(metavar="MHZ", help="CPU clock, for the time.")] = 22.0,
    wait_states: Annotated[
        int, typer.Option(metavar="N", help="Of the flash, 0 to 7; above 0 prefetch and caches are on.")
    ] = 0,
    repeat: Annotated[int, typer.Option(metavar="N", help="Call it N times.")] = 1,
    keep: Annotated[
        bool, typer.Option("--keep", help="Memory stays as the last call left it.  [default: loaded anew]")
    ] = False,
    stack: Annotated[str, typer.Option(metavar="ADDR", help="Top of the stack.")] = "0x2001C000",
    limit: Annotated[
        int, typer.Option(metavar="CYCLES", help="A call that takes longer is a fault.")
    ] = 1_000_000_000,
    dump: Annotated[
        list[str] | None,
        typer.Option(metavar="SYMBOL:BYTES", help="Show memory after the last call; may be repeated."),
    ] = None,
    json_out: Annotated[
        Path | None, typer.Option("--json", metavar="OUT", help="Write the result as JSON; - for stdout.")
    ] = None,
) -> None:
    """Call one function and count its cycles, from its first instruction to its return.

    The file needs no vector table: code and data are put at their link addresses, the stack below 0x2001C000,
    the FPU is on, no interrupt comes. Up to four arguments go to R0-R3, further ones on the stack; a result
    is read from R0. The time of the returning branch is included, nothing after it.

    JSON: cycles (the model's), optimistic, pessimistic, instructions, r0, r1, microseconds and dump
    (SYMBOL: hex), as of the first call; repeat: count, mean, sd, min and max of the cycles of all calls.

    Exit code 2: bad input, or a fault of the function, which includes one that does not return.
    """
    from targets.mcu.call import Caller, function, word
    from targets.mcu.image import load
    from targets.mcu.memory_map import ends_in_ram

    _check(0.001 <= clock <= MAX_MHZ, f"--clock is {clock:g} MHz; it must be within 0.001 and {MAX_MHZ:g}")
    _check(0 <= wait_states <= MAX_WAIT_STATES, f"--wait-states is {wait_states}; it must be within 0 and 7")
    _check(repeat >= 1, f"--repeat is {repeat}; it must be at least 1")
    _check(limit >= 1, f"--limit is {limit}; it must be at least 1")
    if json_out:
        _check_json(json_out)
    image = load(elf, vectors=None)
    function(image, symbol)
    words = [word(image, text) for text in arguments or []]
    wanted = [_wanted(image, text) for text in dump or []]
    top = _address("--stack", stack)
    _check(ends_in_ram(top), f"--stack is {stack}; it must lie in RAM")

    caller = Caller(image, round(clock * 1e6), wait_states, top)
    outcomes = []
    for number in _tracked(range(repeat), f"calling {symbol}"):
        if number and not keep:
            caller.reload()
        outcomes.append(caller.call(symbol, words, limit))
    first = outcomes[0]
    result: dict[str, Any] = {
        "elf": str(elf),
        "sha256": image.digest,
        "symbol": symbol,
        "arguments": words,
        "clock_mhz": clock,
        "wait_states": wait_states,
        **first._asdict(),
        "microseconds": first.cycles / clock,
        "repeat": _statistics(outcomes),
        "dump": {name: caller.dump(address, count).hex() for name, address, count in wanted},
    }
    if json_out is None or str(json_out) != "-":
        _show_call(result, arguments or [])
    _write_json(json_out, result)


def _statistics(outcomes: list[Outcome]) -> dict[str, float]:
    cycles = [outcome.cycles for outcome in outcomes]
    return {
        "count": len(cycles),
        "mean": statistics.fmean(cycles),
        "sd": statistics.stdev(cycles) if len(cycles) > 1 else 0.0,
        "min": min(cycles),
        "max": max(cycles),
    }


def _show_call(result: dict[str, Any], arguments: list[str]) -> None:
    """The result as lines of text."""
    say = typer.echo
    cycles, instructions = result["cycles"], result["instructions"]
    say(f"{result['symbol']}({', '.join(arguments)}) on the emulated STM32F405")
    say(f"  cycles        {cycles} (optimistic {result['optimistic']}, pessimistic {result['pessimistic']})")
    say(
        f"  time          {result['microseconds']:.3f} us at {result['clock_mhz']:g} MHz, "
        f"{result['wait_states']} wait states"
    )
    say(f"  instructions  {instructions}, {cycles / max(instructions, 1):.2f} cycles each")
    say("  result        " + ", ".join(f"{r} = {result[r]} ({result[r]:#010x})" for r in ("r0", "r1")))
    calls = result["repeat"]
    if calls["count"] > 1:
        say(
            f"  {calls['count']} calls: mean {calls['mean']:.1f} cycles, sd {calls['sd']:.2f}, "
            f"{calls['min']} to {calls['max']}"
            if calls["min"] < calls["max"]
            else f"  {calls['count']} calls, all of {calls['min']} cycles"
        )
    for name, content in result["dump"].items():
        say(f"  {name}: {content}")


@app.command()
def run(
    elf: AnyElf,
    can: Annotated[
        str | None,
        typer.Option(metavar="IFACE[:CHANNEL]", help="A live bus, in wall time, e.g. socketcan:vcan0."),
    ] = None,
    bitrate: Annotated[int, typer.Option(metavar="BIT/S", help="Of the bus.")] = 500_000,
    until: Annotated[
        float | None,
        typer.Option(metavar="S", help="Stop after so long.  [default: 1 s; on a live bus Ctrl-C]"),
    ] = None,
    vectors: Annotated[
        str, typer.Option(metavar="ADDR", help="Where the vector table is, if a boot loader is skipped.")
    ] = "0x08000000",
    usart: Annotated[
        bool, typer.Option("--usart", help="Show what it writes to its USARTs and to ITM as it comes.")
    ] = False,
    trace: Annotated[bool, typer.Option("--trace", help="Show each function as it is entered.")] = False,
    trace_blocks: Annotated[
        bool, typer.Option("--trace-blocks", help="Show each basic block as it is run.")
    ] = False,
    trace_out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the trace there.  [default: stdout]")
    ] = None,
    json_out: Annotated[
        Path | None, typer.Option("--json", metavar="OUT", help="Write the result as JSON; - for stdout.")
    ] = None,
) -> None:
    """Run a firmware from its vector table and report what it did.

    Without --can its frames go over a timed bus with one other node, which acknowledges. Ctrl-C ends a run
    with its report.

    Exit code 0: it ran as long as it was to. 2: bad input, or a fault of the firmware.
    """
    from bench.cli.mcu_run import Options, report
    from bench.whole import check_writable
    from targets.mcu.image import load

    at = _address("--vectors", vectors)
    _check(until is None or 0 < until <= 1e6, f"--until is {until} s; it must be above 0, up to 1e6")
    if json_out:
        _check_json(json_out)
    if trace_out:
        check_writable(trace_out)
    quiet = str(json_out) == "-"
    options = Options(can, bitrate, until, trace or trace_blocks, trace_blocks, trace_out, usart, quiet)
    result, fault = report(load(elf, at), options)
    _write_json(json_out, result)
    if fault:
        raise fault


def _address(option: str, text: str) -> int:
    from bench.errors import BenchError

    try:
        return int(text, 0)
    except ValueError:
        raise BenchError(f"{option} is {text}, which is no address") from None


def _wanted(image: Any, text: str) -> tuple[str, int, int]:
    """Name, address and length of SYMBOL:BYTES."""
    from bench.errors import BenchError
    from targets.mcu.call import place
    from targets.mcu.memory_map import holds

    name, _, length = text.rpartition(":")
    if not name or not length.isdecimal():
        raise BenchError(f"--dump is {text}; it must be SYMBOL:BYTES")
    address = place(image, name)
    _check(
        int(length) > 0 and holds(address, int(length)),
        f"--dump is {text}: {length} bytes at {address:#010x} do not lie in memory",
    )
    return name, address, int(length)


def _tracked(numbers: range, what: str) -> Any:
    """The numbers, with a bar on a terminal where there are many."""
    from rich.console import Console
    from rich.progress import track

    screen = Console(stderr=True)
    quiet = len(numbers) < 100 or not screen.is_terminal
    return track(numbers, what, console=screen, transient=True, disable=quiet)


def _check(holds: bool, complaint: str) -> None:
    from bench.errors import BenchError

    if not holds:
        raise BenchError(complaint)


def _check_json(out: Path) -> None:
    from bench.whole import check_writable

    if str(out) != "-":
        check_writable(out)


def _write_json(out: Path | None, result: dict[str, Any]) -> None:
    from bench.whole import whole

    if out is None:
        return
    content = json.dumps(result, indent=2) + "\n"
    if str(out) == "-":
        typer.echo(content, nl=False)
        return
    with whole(out) as part:
        part.write_text(content, encoding="utf-8")
