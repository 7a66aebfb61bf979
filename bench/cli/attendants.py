"""Those who attend a live replay: the fault panel and the sockets by which it is worked."""

import json
import os
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager, nullcontext

from bench.cli.control_socket import ControlSocket, address
from bench.cli.keyboard import Keyboard
from bench.control import LONGEST, answer
from bench.panel import Panel
from bench.script import Script


@contextmanager
def attending(
    bus: str,
    script: Script,
    ground: Callable[[Panel], AbstractContextManager[Callable[[int], None]]] | None = None,
    keys: Mapping[str, str] | None = None,
    say: Callable[[str], None] = lambda text: None,
) -> Iterator[list[Callable[[int], None]]]:
    """What a replay of `script` on `bus` is to call with the bench time, once a cycle.

    ground: one more. keys: what the terminal's keys fire, if there is one. say: shows what came of that.
    """
    # One thread: changed laps are planned beside the replay, one after the other.
    with ThreadPoolExecutor(1, "planner") as executor:
        panel = Panel(script, executor)
        # A virtual bus ends with its process: each process has one of that name.
        name = f"{bus}-{os.getpid()}" if bus.startswith("virtual") else bus
        with (
            ControlSocket(address(name), lambda line, t_ns: answer(line, panel, t_ns), LONGEST) as control,
            ground(panel) if ground else nullcontext() as link,
            Keyboard(0) as keyboard,
        ):
            if keyboard.listening and keys:
                say(f"keys: {', '.join(map(' '.join, keys.items()))}; c clears, q quits")
            pressed = PanelKeys(keyboard, panel, keys or {}, say)
            yield [control.turn, pressed.turn, panel.settle, *([link] if link else [])]


class PanelKeys:
    """Works `panel` by keys: those of `keys` fire their fault, c clears, q is Ctrl-C."""

    def __init__(
        self, keyboard: Keyboard, panel: Panel, keys: Mapping[str, str], say: Callable[[str], None]
    ) -> None:
        self._keyboard, self._panel, self._keys, self._say = keyboard, panel, keys, say

    def turn(self, t_ns: int) -> None:
        """Do at bench time `t_ns` what the keys pressed since the last turn ask for."""
        for key in self._keyboard.pressed():
            if key == "q":
                raise KeyboardInterrupt
            if key == "c":
                self._ask(t_ns, "cleared", {"do": "clear"})
            elif key in self._keys:
                fault = self._keys[key]
                self._ask(t_ns, f"fired {fault}", {"do": "fire", "fault": fault})

    def _ask(self, t_ns: int, done: str, request: dict[str, str]) -> None:
        reply = json.loads(answer(json.dumps(request).encode(), self._panel, t_ns))
        self._say(f"{t_ns / 1e9:.3f} s  {reply.get('error', done)}")
