"""The monitor's turns: frames first, then keys, the replay's answers, and the screen when there is time."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Protocol

from bench.errors import BusError

if TYPE_CHECKING:
    from bench.bus.live import Heard
    from bench.cli.keyboard import Keyboard
    from bench.cli.monitor_faults import Answer, FaultLink
    from bench.cli.monitor_record import Write
    from bench.cli.monitor_screen import Frame
    from bench.live import Bus
    from bench.monitor.model import Monitor
    from bench.monitor.rows import Look

TURN_NS = 50_000_000
"""How often, at most, anything but frames is looked after."""

REFRESH_NS = 100_000_000
"""The screen is drawn at most ten times a second."""

SHARE = 10
"""And takes at most this part of the time: one tenth."""

BEHIND_NS = 20_000_000
BEHIND_REFRESH_NS = 2_000_000_000
"""Frames that wait longer than this are read first; the screen is then drawn this rarely."""

Clock = Callable[[], int]


class Output(Protocol):
    """Where the looks go: a screen, or lines. every_ns: how often one is due."""

    every_ns: int

    def show(self, look: Look, frame: Frame) -> None:
        """The bus as it is now."""


@dataclass
class Session:
    """What happens between frames. clock: ns since the monitor began. dropped: what the kernel threw away."""

    monitor: Monitor
    keyboard: Keyboard
    link: FaultLink
    output: Output
    frame: Frame
    clock: Clock
    dropped: Callable[[], int | None] = lambda: None
    _due_ns: int = 0
    _shown: Look | None = field(default=None)

    def turn(self, now_ns: int, lag_ns: int) -> bool:
        """Look after keys, answers and the screen; `lag_ns`: how long the last frame waited. False: quit."""
        for key in self.keyboard.pressed():
            if key == "q":
                return False
            self._key(key, now_ns)
        for answer in self.link.turn():
            self._answer(answer)
        if now_ns >= self._due_ns and (
            lag_ns < BEHIND_NS or now_ns >= self._due_ns - self.output.every_ns + BEHIND_REFRESH_NS
        ):
            self._show(now_ns)
        return True

    def _key(self, key: str, now_ns: int) -> None:
        if key == " ":
            self.frame = replace(self.frame, paused=not self.frame.paused)
            self._due_ns = now_ns
        elif key == "c":
            self._request("clear", None, "clearing")
        elif key in self.frame.keys:
            fault = self.frame.keys[key]
            self._request("fire", fault, f"firing {fault}")

    def _request(self, do: str, fault: str | None, note: str) -> None:
        self.link.request(do, fault)
        self.frame = replace(self.frame, note=note)

    def _answer(self, answer: Answer) -> None:
        from bench.monitor.detection import Told

        detection = self.monitor.detection
        do = answer.request["do"]
        told = Told.of(answer.reply) if answer.reply else None
        if told:
            detection.told(answer.t_ns, told)
        elif do == "list":
            detection.gone()
        if do != "list":
            done = "cleared" if do == "clear" else f"fired {answer.request['fault']}"
            self.frame = replace(self.frame, note=answer.error or done)

    def _show(self, now_ns: int) -> None:
        self.monitor.dropped = self.dropped()
        # a screen that is held still shows what it showed; everything goes on behind it
        if self._shown is None or not self.frame.paused:
            self._shown = self.monitor.look(now_ns)
        self.output.show(self._shown, self.frame)
        cost_ns = self.clock() - now_ns
        self._due_ns = now_ns + max(self.output.every_ns, SHARE * cost_ns)


def listen(
    bus: Bus,
    monitor: Monitor,
    write: Write,
    turn: Callable[[int, int], bool],
    clock: Clock,
    seconds: float | None = None,
) -> None:
    """Hear the bus for `seconds`, or until `turn` (instant, lag of the last frame) says False.

    Raises BusError if the bus goes away, RecordError if the recording cannot go on.
    """
    heard_ns, turned_ns = 0, -TURN_NS

    def take(heard: Heard, now_ns: int) -> None:
        nonlocal heard_ns
        heard_ns = max(heard_ns, now_ns - heard.age_ns)
        monitor.heard(heard_ns, heard.frame, heard.age_ns)
        write(heard_ns, heard.frame)

    try:
        while seconds is None or clock() < seconds * 1e9:
            heard = bus.receive(TURN_NS / 1e9)
            now_ns = clock()
            if heard:
                take(heard, now_ns)
            if heard is None or now_ns - turned_ns >= TURN_NS:
                turned_ns = now_ns
                if not turn(now_ns, heard.age_ns if heard else 0):
                    return
    except BusError:
        # What came before the bus went down still lies in the queue; a second error ends that, too.
        with suppress(BusError):
            while heard := bus.receive(0.0):
                take(heard, clock())
        raise


def since_now(clock: Clock = time.monotonic_ns) -> Clock:
    """A clock that begins at 0."""
    begun = clock()
    return lambda: clock() - begun
