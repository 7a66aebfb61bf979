"""The monitor's line to a replay of this machine: faults fired and cleared, and what has become of them.

The replay answers when it has time; a thread waits for it, so that no frame does.
"""

import json
import queue
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from bench.errors import BenchError

_POLL_NS = 500_000_000
_PATIENCE_S = 2.0


class Answer(NamedTuple):
    """What came of a request: the replay's reply, or why there is none; true at `t_ns`."""

    t_ns: int
    request: Mapping[str, Any]
    reply: dict[str, Any] | None
    error: str | None


class FaultLink:
    """Asks the replay that listens at `path`, one request after the other; `clock` in ns.

    Use `turn` about ten times a second: it asks for the faults now and then, and returns what was answered.
    """

    def __init__(
        self, path: Path, clock: Callable[[], int], ask: Callable[[Path, bytes, float], bytes]
    ) -> None:
        self._path, self._clock, self._ask = path, clock, ask
        self._asked: queue.SimpleQueue[Mapping[str, Any]] = queue.SimpleQueue()
        self._answers: queue.SimpleQueue[Answer] = queue.SimpleQueue()
        self._listed_ns: int | None = None
        self._listing = False
        # A replay that hangs may not keep the monitor from ending.
        threading.Thread(target=self._work, name="faults", daemon=True).start()

    def request(self, do: str, fault: str | None = None) -> None:
        """Ask for `do`: fire (a fault) or clear (all)."""
        self._asked.put({"do": do, "fault": fault})

    def turn(self) -> list[Answer]:
        """What has been answered since the last call."""
        now_ns = self._clock()
        if not self._listing and (self._listed_ns is None or now_ns - self._listed_ns >= _POLL_NS):
            self._listing = True
            self._listed_ns = now_ns
            self.request("list")
        answers = []
        while not self._answers.empty():
            answers.append(self._answers.get())
            self._listing = self._listing and answers[-1].request["do"] != "list"
        return answers

    def _work(self) -> None:
        while True:
            request = self._asked.get()
            begun_ns = self._clock()
            reply, error = self._answer(request)
            # the replay read its clock somewhere between the question and the answer
            self._answers.put(Answer((begun_ns + self._clock()) // 2, request, reply, error))

    def _answer(self, request: Mapping[str, Any]) -> tuple[dict[str, Any] | None, str | None]:
        try:
            reply = json.loads(self._ask(self._path, json.dumps(request).encode(), _PATIENCE_S))
        except BenchError as error:
            return None, str(error)
        except ValueError:
            return None, f"the replay at {self._path} gave no answer that can be read"
        if not isinstance(reply, dict) or "error" in reply:
            return None, str(reply["error"] if isinstance(reply, dict) else reply)
        return reply, None
