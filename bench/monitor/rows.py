"""What the monitor shows, as plain values: one look at the bus."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.monitor.detection import Fault


@dataclass(frozen=True)
class SignalRow:
    """One signal: latest value, lowest and highest of the time remembered, and the means of its bins.

    means: float64 (bins,), the latest last, NaN where no frame came. age_ns: since its last frame.
    """

    message: str
    name: str
    unit: str
    value: float
    low: float
    high: float
    means: NDArray[np.float64]
    age_ns: int


@dataclass(frozen=True)
class MessageRow:
    """One message of the DBC: frames so far and in the last second, and what its counter says.

    due_per_s: by the DBC, None if it is not cyclic. lost, repeats, restarts: None without a counter.
    wrong: frames of another length than the DBC says; wrong_length: the last one's.
    """

    name: str
    id: int
    extended: bool
    length: int
    frames: int
    per_s: float
    mean_per_s: float
    due_per_s: float | None
    lost: int | None
    repeats: int | None
    restarts: int | None
    wrong: int
    wrong_length: int
    age_ns: int


@dataclass(frozen=True)
class EcuRow:
    """One ECU; None for what it has not said. since_s: since the alarm was raised or taken back.

    load: step time over the time between two answers. td_s: of the latest alarm, bench time.
    """

    role: str
    answers: int
    predicted_mm: float | None
    residual_pct: float | None
    threshold_pct: float | None
    alarm: bool
    kind: str | None
    alarms: int
    since_s: float | None
    td_s: float | None
    step_s: float | None
    worst_step_s: float | None
    load: float | None
    missed_inputs: int
    overruns: int


@dataclass(frozen=True)
class Look:
    """All that the monitor knows at `t_ns`, counted from when it began to listen.

    load: of the bus in the last second, 0 to 1, intermissions included. unknown: frames the DBC does not
    know; unknown_ids: how many identifiers they had, at least. dropped: frames the kernel threw away because
    nobody read them in time, None where it does not tell. worst_age_ns: the longest a frame had waited to be
    read. complaints: what is wrong, a line each.
    """

    t_ns: int
    frames: int
    per_s: float
    load: float
    bitrate: int
    signals: tuple[SignalRow, ...]
    messages: tuple[MessageRow, ...]
    ecus: tuple[EcuRow, ...]
    faults: tuple[Fault, ...]
    unknown: int
    unknown_ids: int
    dropped: int | None
    worst_age_ns: int
    complaints: tuple[str, ...]

    @property
    def lost(self) -> int:
        """Frames missing by all counters."""
        return sum(row.lost or 0 for row in self.messages)

    @property
    def repeats(self) -> int:
        """Frames that came twice by all counters."""
        return sum(row.repeats or 0 for row in self.messages)
