"""Those who attend a live replay: the fault panel and the sockets by which it is worked."""

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager, nullcontext

from bench.cli.control_socket import ControlSocket, address
from bench.control import LONGEST, answer
from bench.panel import Panel
from bench.script import Script


@contextmanager
def attending(
    bus: str,
    script: Script,
    ground: Callable[[Panel], AbstractContextManager[Callable[[int], None]]] | None = None,
) -> Iterator[list[Callable[[int], None]]]:
    """What a replay of `script` on `bus` is to call with the bench time, once a cycle; ground: one more."""
    # One thread: changed laps are planned beside the replay, one after the other.
    with ThreadPoolExecutor(1, "planner") as executor:
        panel = Panel(script, executor)
        # A virtual bus ends with its process: each process has one of that name.
        name = f"{bus}-{os.getpid()}" if bus.startswith("virtual") else bus
        with (
            ControlSocket(address(name), lambda line, t_ns: answer(line, panel, t_ns), LONGEST) as control,
            ground(panel) if ground else nullcontext() as link,
        ):
            yield [control.turn, panel.settle, *([link] if link else [])]
