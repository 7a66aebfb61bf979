"""What `bench mcu run` shows of a firmware: its trace while it runs, a report when it ends."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TextIO

import typer

if TYPE_CHECKING:
    from bench.solo import Tally
    from targets.emulated import EmulatedEcu
    from targets.errors import FirmwareFault
    from targets.mcu.image import Image
    from targets.mcu.machine import Stm32f405

TRACE_LOOK_NS = 1_000_000
"""Emulated time between two looks at the trace, which has room for this much."""

DEFAULT_S = 1.0
LAST_LINES = 20
BEHIND_S = 0.05
"""A live run further behind than this is no live run."""


class Options(NamedTuple):
    """What was asked for; see `bench mcu run --help`."""

    can: str | None
    bitrate: int
    until_s: float | None
    trace: bool
    every_block: bool
    trace_out: Path | None
    usart: bool
    quiet: bool


def report(image: Image, options: Options) -> tuple[dict[str, Any], FirmwareFault | None]:
    """Run `image` as asked, say what it did, and return it for a file; with the fault that ended it."""
    from targets.errors import FirmwareFault

    fault, ended = None, "time"
    ecu = _powered(image, options)
    if not image.symbols:
        typer.echo(f"bench: firmware: {image.source} has no symbols: addresses alone are shown", err=True)
    with _trace(ecu, options) as follow_trace:
        follow_text = _Text(ecu.mcu).show if options.usart else lambda: None

        def follow() -> None:
            follow_trace()
            follow_text()

        run = _Run(ecu, options, follow)
        try:
            run.go()
        except KeyboardInterrupt:
            ended = "interrupted"
        except FirmwareFault as error:
            fault, ended = error, "fault"
        follow()
    result = _result(ecu, run.tally, ended, str(fault) if fault else None)
    result["behind_s"] = run.behind_s()
    if not options.quiet:
        _show(result)
    return result, fault


def _powered(image: Image, options: Options) -> EmulatedEcu:
    from targets.emulated import EmulatedEcu

    return EmulatedEcu(image, None, "mcu", power_on_ns=0, bitrate=options.bitrate)


class _Run:
    """One run and what is known of it, however it ends."""

    def __init__(self, ecu: EmulatedEcu, options: Options, follow: Callable[[], None]) -> None:
        from bench.solo import Tally

        self._ecu, self._options, self._follow = ecu, options, follow
        self.tally = Tally()
        self._begun_s: float | None = None  # of a live run

    def go(self) -> None:
        """Run to the end, KeyboardInterrupt or FirmwareFault."""
        from bench.cli.stop import stoppable

        with stoppable():
            if self._options.can:
                self._live(self._options.can)
            else:
                self._alone()

    def behind_s(self) -> float | None:
        """How far a live run has fallen behind the clock on the wall, None in virtual time."""
        if self._begun_s is None:
            return None
        return max(0.0, time.monotonic() - self._begun_s - self._ecu.mcu.now_ns / 1e9)

    def _live(self, name: str) -> None:
        from bench.bus.live import LiveBus
        from bench.serve import rehearse
        from bench.solo import Watched, run_live
        from targets.errors import FirmwareFault

        def ready() -> None:
            self._begun_s = time.monotonic()
            typer.echo(f"on {name} at {self._options.bitrate} bit/s; Ctrl-C ends it", err=True)

        with LiveBus(name, self._options.bitrate) as bus:
            with suppress(FirmwareFault):  # the run itself will meet it
                rehearse(_powered(self._ecu.mcu.image, self._options))
            device = Watched(self._ecu, lambda _: self._follow(), self._every_ns())
            run_live(device, bus, self.tally, self._options.until_s, ready)

    def _alone(self) -> None:
        from bench.bus.timed import TimedBus
        from bench.cli.progress import lap_progress
        from bench.solo import run

        until_ns = round((self._options.until_s or DEFAULT_S) * 1e9)
        # A bar and other lines on one terminal would write over each other.
        shown = self._options.usart or (self._options.trace and self._options.trace_out is None)
        with nullcontext(lambda _: None) if shown else lap_progress(until_ns, "running") as tell:

            def look(t_ns: int) -> None:
                self._follow()
                tell(t_ns)

            bus = TimedBus(self._options.bitrate)
            run(self._ecu, bus, until_ns, self.tally, look, self._every_ns())

    def _every_ns(self) -> int:
        from bench.solo import LOOK_NS

        return TRACE_LOOK_NS if self._options.trace else LOOK_NS


@contextmanager
def _trace(ecu: EmulatedEcu, options: Options) -> Iterator[Callable[[], None]]:
    """Yields what writes down the steps since it was last called."""
    import sys

    from targets.mcu.trace import Trace

    if not options.trace:
        yield lambda: None
        return
    steps = Trace(ecu.mcu, options.every_block)
    target = options.trace_out.open("w", encoding="utf-8") if options.trace_out else nullcontext(sys.stdout)
    with target as out:
        yield lambda: _write_steps(steps.take(), ecu.mcu.image, out)


class _Text:
    """Shows what the firmware has written to its USARTs and to ITM since the last time."""

    def __init__(self, mcu: Stm32f405) -> None:
        from targets.mcu import textlog

        self._mcu, self._log = mcu, textlog.log
        self._seen = dict.fromkeys(textlog.NAMES, 0)

    def show(self) -> None:
        for name, seen in self._seen.items():
            found = self._log(self._mcu, name)
            self._seen[name] = found.lost + len(found.data)
            if fresh := found.data[len(found.data) - (self._seen[name] - seen) :].tobytes():
                typer.echo(fresh.decode("utf-8", "replace"), nl=False)


def _write_steps(taken: Any, image: Image, out: TextIO) -> None:
    steps, lost = taken
    for t_ns, address in steps:
        name, line = image.function_at(address), image.line_at(address)
        out.write(f"{t_ns / 1e9:.9f} {address:#010x} {name} {line}".rstrip() + "\n")
    if lost:
        out.write(f"... {lost} more that there was no room for\n")


def _result(ecu: EmulatedEcu, tally: Tally, ended: str, fault: str | None) -> dict[str, Any]:
    from bench.bus.timed import EXTENDED
    from targets.mcu import gating, limits, state, textlog
    from targets.mcu.registers import name

    mcu = ecu.mcu
    S = mcu.state
    return {
        "elf": mcu.image.source,
        "sha256": mcu.image.digest,
        "ended": ended,
        "fault": fault,
        "seconds": mcu.now_ns / 1e9,
        "cycles": mcu.cycles,
        "optimistic": int(S[state.CYCLES_MIN]),
        "pessimistic": int(S[state.CYCLES_MAX]),
        "hz": mcu.hz,
        "hz_since_s": int(S[state.BASE_NS]) / 1e9,
        "wait_states": int(S[state.FLASH_ACR]) & 7,
        "sleeping": bool(S[state.SLEEPING]),
        "where": mcu.where(),
        "frames": [
            {
                "id": key & ~EXTENDED,
                "extended": bool(key & EXTENDED),
                "frames": sent.frames,
                "first_s": sent.first_ns / 1e9,
                "last_s": sent.last_ns / 1e9,
                "period_ms": None if sent.period_ns is None else sent.period_ns / 1e6,
                "last_data": sent.data.hex(),
            }
            for key, sent in sorted(tally.by_id.items())
        ],
        "text": {
            unit: said.decode("utf-8", "replace")
            for unit in textlog.NAMES
            if (said := textlog.output(mcu, unit))
        },
        "beyond_limits": limits.warnings(S),
        "without_clock": gating.unclocked(S),
        "unmodelled": [
            {"address": address, "register": name(address), "accesses": times}
            for address, times in sorted(mcu.unmodelled().items())
        ],
    }


def _show(result: dict[str, Any]) -> None:
    say = typer.echo
    bounds = f"(optimistic {result['optimistic']}, pessimistic {result['pessimistic']})"
    say(f"{result['elf']} on the emulated STM32F405")
    say(f"  ran        {result['seconds']:.6f} s, {result['cycles']} cycles {bounds}")
    say(
        f"  clock      {result['hz'] / 1e6:g} MHz since {result['hz_since_s']:.6f} s, "
        f"flash at {result['wait_states']} wait states"
    )
    ends = {"time": "", "interrupted": "interrupted, ", "fault": "ended by a fault, "}[result["ended"]]
    say(f"  at the end {ends}{'asleep' if result['sleeping'] else 'running'} at {result['where']}")
    if (result["behind_s"] or 0.0) >= BEHIND_S:
        say(f"  too slow   {result['behind_s']:.3f} s behind the clock on the wall: its frames came late")
    if result["frames"]:
        say(f"  CAN        {sum(row['frames'] for row in result['frames'])} frames sent")
        say("             id        frames  first s    period ms  last data")
        for row in result["frames"]:
            number = f"{row['id']:08x}" if row["extended"] else f"{row['id']:03x}     "
            period = "-" if row["period_ms"] is None else f"{row['period_ms']:.3f}"
            say(f"{'':13}{number}  {row['frames']:6}  {row['first_s']:9.6f}  {period:>9}  {row['last_data']}")
    for unit, text in result["text"].items():
        say(f"  {unit:<10} {len(text)} characters" + (", the last lines:" if text.strip() else ""))
        for line in text.splitlines()[-LAST_LINES:]:
            say(f"{'':13}{line}")
    for kind, words in (("beyond_limits", "beyond the data sheet"), ("without_clock", "clock off")):
        for what, times in result[kind].items():
            say(f"  {words}: {what}, {times} times")
    if result["unmodelled"]:
        say("  not modelled: reads gave 0, writes did nothing")
        for row in result["unmodelled"]:
            say(f"{'':13}{row['address']:#010x}  {row['register']:<16}  {row['accesses']} times")
