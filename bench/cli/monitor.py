"""`bench monitor`: a live bus on the screen, its recording, and keys that inject faults."""

from __future__ import annotations

import os
import sys
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bench.cli.options import Bitrate, BusName, Keys, Model, json_of, write_json
from bench.cli.stop import stoppable

if TYPE_CHECKING:
    from collections.abc import Iterator

    from bench.cli.monitor_live import Output
    from bench.cli.monitor_screen import Frame
    from bench.monitor.rows import Look

SECOND_NS = 1_000_000_000


def monitor(
    bus: BusName,
    bitrate: Bitrate = 500_000,
    dbc: Annotated[
        Path | None, typer.Option("--dbc", metavar="FILE", help="What the frames mean.  [default: shipped]")
    ] = None,
    model: Model = None,
    clock: Annotated[float, typer.Option(metavar="MHZ", min=0.1, max=1000, help="Of the ECU's CPU.")] = 22.0,
    key: Keys = None,
    seconds: Annotated[
        float | None, typer.Option(min=0, help="Stop after so long.  [default: q or Ctrl-C]")
    ] = None,
    record_out: Annotated[
        Path | None,
        typer.Option("--record", metavar="OUT", help="Record the bus (.log as it comes; .asc, .blf, .mf4)."),
    ] = None,
    json_out: Annotated[Path | None, json_of("the summary")] = None,
    ascii_only: Annotated[bool, typer.Option("--ascii", help="Draw with ASCII characters.")] = False,
) -> None:
    """Show a live CAN bus: signals, residual, alarm, step time, loads, counters and their errors.

    Keys: 1 to 9 (or those of --key) fire a fault in the replay on this bus, c clears, space holds the screen,
    q quits. Without a terminal: one line a second. The residual's threshold is shown with --model.
    """
    from bench.bus.bits import frame_bits
    from bench.bus.live import LiveBus
    from bench.cli.control_socket import address, ask
    from bench.cli.keyboard import Keyboard, key_faults
    from bench.cli.monitor_faults import FaultLink
    from bench.cli.monitor_live import Session, listen, since_now
    from bench.cli.monitor_record import recording
    from bench.cli.monitor_screen import Frame
    from bench.codec import Codec
    from bench.monitor.model import Monitor
    from bench.recorder import check_target
    from bench.whole import check_writable

    keys = key_faults(key or [])
    replay = address(bus)
    if json_out:
        check_writable(json_out)
    if record_out:
        check_target(record_out)
    watched = Monitor(Codec(dbc) if dbc else Codec(), bitrate, clock * 1e6, _threshold_pct(model))
    frame_bits(0, b"")  # compiled, or read from its cache, before the first frame comes
    title = Frame(f"{bus} {bitrate // 1000} kbit/s", keys, recording=record_out.name if record_out else "")
    with LiveBus(bus, bitrate) as live, stoppable():
        now = since_now()
        try:
            with recording(record_out) as write, Keyboard(0) as keyboard, _output(ascii_only) as output:
                link = FaultLink(replay, now, ask)
                session = Session(watched, keyboard, link, output, title, now, live.dropped)
                with suppress(KeyboardInterrupt):
                    listen(live, watched, write, session.turn, now, seconds)
        finally:
            watched.dropped = live.dropped()
            _end(watched.look(now()), json_out)


def _end(look: Look, json_out: Path | None) -> None:
    from bench.cli.monitor_text import document, summary

    write_json(json_out, document(look))
    with suppress(KeyboardInterrupt):
        for text in summary(look):
            _say(text)


def _say(text: str) -> None:
    """One line; nobody there to read it any more is as good as Ctrl-C."""
    from bench.cli.draw import plain

    try:
        typer.echo(plain(text))
    except BrokenPipeError:
        # what is flushed at exit would raise again
        sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115  # for the rest of the process
        raise KeyboardInterrupt from None


def _threshold_pct(model: Path | None) -> float | None:
    """What the detector of the calibration `model` compares its residual with, in %."""
    if model is None:
        return None
    from targets.calibration import load
    from targets.detector import Checks

    detector = load(model).detector
    return 100 * (detector.loss_threshold if isinstance(detector, Checks) else detector.threshold)


@contextmanager
def _output(ascii_only: bool) -> Iterator[Output]:
    """A screen where there is one, else a line a second."""
    from rich.console import Console

    console = Console()
    if not console.is_terminal:
        yield _Lines()
        return
    from rich.live import Live

    # Drawn when there is time for it, not by a thread.
    with Live(console=console, screen=True, auto_refresh=False) as live:
        yield _Screen(live, ascii_only)


class _Screen:
    def __init__(self, live, ascii_only: bool) -> None:  # type: ignore[no-untyped-def]  # rich's Live
        from bench.cli.draw import style_for
        from bench.cli.monitor_live import REFRESH_NS

        self.every_ns = REFRESH_NS
        self._live, self._style = live, style_for(ascii_only)

    def show(self, look: Look, frame: Frame) -> None:
        from bench.cli.monitor_screen import screen

        width, height = self._live.console.size
        self._live.update(screen(look, frame, width, height, self._style), refresh=True)


class _Lines:
    every_ns = SECOND_NS

    def show(self, look: Look, frame: Frame) -> None:
        from bench.cli.monitor_text import line

        if look.t_ns >= SECOND_NS // 2:  # nothing to say of the first instant
            _say(line(look))
