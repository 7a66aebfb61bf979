"""The time to detect, for a listener: alarms are heard on the bus, faults are told by the replay.

The replay counts bench time, which may run faster or slower than the listener's clock; every reply of the
replay is an instant known on both. Belongs here: the mapping and the difference. Never: a socket.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

_MOST_ANCHORS = 64


class Fault(NamedTuple):
    """A fault of the replay: bench times in s, None where it is not known or has not happened."""

    number: int
    spec: str
    state: str
    t_active_s: float | None = None
    t_end_s: float | None = None


class _Anchor(NamedTuple):
    t_ns: int
    bench_s: float


@dataclass(frozen=True)
class Told:
    """A reply of the replay: its bench time, and its faults."""

    bench_s: float
    faults: tuple[Fault, ...]

    @classmethod
    def of(cls, reply: dict[str, Any]) -> "Told | None":
        """From the reply's document; None if it is not one."""
        try:
            faults = tuple(
                Fault(
                    int(row["number"]),
                    str(row["spec"]),
                    str(row["state"]),
                    None if row.get("t_active_s") is None else float(row["t_active_s"]),
                    None if row.get("t_end_s") is None else float(row["t_end_s"]),
                )
                for row in reply["faults"]
            )
            return cls(float(reply["t_s"]), faults)
        except (KeyError, TypeError, ValueError, AttributeError):
            return None


class Detection:
    """What the replay told, on the listener's clock. faults: as last told."""

    def __init__(self) -> None:
        self._anchors: deque[_Anchor] = deque(maxlen=_MOST_ANCHORS)
        self._settled: tuple[int, float] | None = None  # an alarm's instant, and its time to detect
        self.faults: Sequence[Fault] = ()

    def told(self, t_ns: int, told: Told) -> None:
        """The replay's reply, which was true at `t_ns` of the listener's clock."""
        if self._anchors and told.bench_s < self._anchors[-1].bench_s:
            self._anchors.clear()  # another replay
        self._anchors.append(_Anchor(t_ns, told.bench_s))
        self.faults = told.faults

    def gone(self) -> None:
        """No replay answers any more."""
        self._anchors.clear()
        self.faults = ()

    def td_s(self, alarm_ns: int) -> float | None:
        """Bench time from the first sample that an active fault changed to the alarm heard at `alarm_ns`.

        None if no replay tells, or no fault was active. Kept for the latest alarm when the replay has ended.
        """
        if self._settled and self._settled[0] == alarm_ns:
            return self._settled[1]
        if not self._anchors:
            return None
        bench_s = self._bench_s(alarm_ns)
        active = [
            fault.t_active_s
            for fault in self.faults
            if fault.t_active_s is not None
            and fault.t_active_s <= bench_s
            and (fault.t_end_s is None or fault.t_end_s > bench_s)
        ]
        if not active:
            return None
        td_s = bench_s - min(active)
        if self._anchors[-1].t_ns >= alarm_ns:
            self._settled = alarm_ns, td_s
        return td_s

    def _bench_s(self, t_ns: int) -> float:
        """Bench time at `t_ns`: between two replies in proportion, else at the speed of the nearest two."""
        after = next((k for k, a in enumerate(self._anchors) if a.t_ns >= t_ns), len(self._anchors) - 1)
        one, two = self._anchors[max(after - 1, 0)], self._anchors[max(after, min(1, len(self._anchors) - 1))]
        wall_ns = two.t_ns - one.t_ns
        speed = (two.bench_s - one.bench_s) / wall_ns if wall_ns > 0 else 1e-9
        return one.bench_s + (t_ns - one.t_ns) * speed
