"""The `bus` fixture: what went over the bus, as signals over time, and what a test expects of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from bench.codec import Message
from bench.errors import BusError
from bench.pytest_plugin.expect import Unmet, instants, seconds

if TYPE_CHECKING:
    from bench.pytest_plugin.ride import Bench
    from bench.recorder import Row


@dataclass(frozen=True, eq=False)
class Signal:
    """One signal as far as the lap has been ridden. t_ns: int64 (frames,); values: float64 (frames,).

    An expectation that is not met raises Unmet, which names the first value and instant that disappoint.
    """

    name: str
    unit: str
    t_ns: NDArray[np.int64]
    values: NDArray[np.float64]
    bench: Bench

    @property
    def t(self) -> NDArray[np.float64]:
        """The instants, s."""
        return self.t_ns / 1e9

    @property
    def last(self) -> float:
        """The latest value."""
        __tracebackhide__ = True
        self._some()
        return float(self.values[-1])

    def at(self, t_s: float) -> float:
        """The value that held at that instant: the latest until then."""
        __tracebackhide__ = True
        before = np.searchsorted(self.t_ns, round(t_s * 1e9), side="right")
        if not before:
            raise Unmet(f"{self.name} at {t_s:g} s", "no frame until then", [])
        return float(self.values[before - 1])

    def between(self, begin_s: float, end_s: float | None = None) -> Signal:
        """The part from `begin_s` on, to `end_s` or to the present."""
        end_ns = self.bench.now_ns if end_s is None else round(end_s * 1e9)
        some = (self.t_ns >= round(begin_s * 1e9)) & (self.t_ns <= end_ns)
        return Signal(self.name, self.unit, self.t_ns[some], self.values[some], self.bench)

    def near(self, value: float, tolerance: float) -> Self:
        """The latest value is within `tolerance` of `value`."""
        __tracebackhide__ = True
        if abs(self.last - value) > tolerance:
            self._fail(self._in_unit(f"{value:g} ± {tolerance:g}"), len(self.values) - 1, "")
        return self

    def below(self, limit: float) -> Self:
        """Every value is below `limit`."""
        __tracebackhide__ = True
        return self._all(self.values < limit, self._in_unit(f"below {limit:g}"))

    def above(self, limit: float) -> Self:
        """Every value is above `limit`."""
        __tracebackhide__ = True
        return self._all(self.values > limit, self._in_unit(f"above {limit:g}"))

    def stays_within(self, reference: float | str | Signal, tolerance: float, share: float = 1.0) -> Self:
        """Of the values, at least `share` (0 to 1) are within `tolerance` of the reference at their instant.

        reference: a number, the name of a channel of the lap, or a signal, which holds until its next frame.
        """
        __tracebackhide__ = True
        self._some()
        expected, said = self._reference(reference)
        good = np.abs(self.values - expected) <= tolerance  # NaN is not
        wanted = f"{self._in_unit(f'within {tolerance:g}')} of {said}"
        if share < 1.0 and good.mean() >= share:
            return self
        if share < 1.0:
            wanted += f" for {100 * share:g} % of {len(good)} frames"
        return self._all(good, wanted, expected)

    def _reference(self, reference: float | str | Signal) -> tuple[NDArray[np.float64], str]:
        __tracebackhide__ = True
        if isinstance(reference, Signal):
            reference._some()
            before = np.searchsorted(reference.t_ns, self.t_ns, side="right") - 1
            held = np.where(before >= 0, reference.values[before], np.nan)
            return held, reference.name
        if isinstance(reference, str):
            lap = self.bench.lap
            lap.require([reference], f"the comparison with {self.name}")
            curve = np.interp(self.t_ns, lap.t_ns - lap.t_ns[0], lap.channels[reference])
            return curve, f"the lap's {reference}"
        return np.full(len(self.values), float(reference)), f"{reference:g}"

    def _all(self, good: NDArray[np.bool_], wanted: str, expected: NDArray[np.float64] | None = None) -> Self:
        __tracebackhide__ = True
        self._some()
        if not good.all():
            k = int(np.argmin(good))
            against = "" if expected is None else f" against {expected[k]:.6g}"
            self._fail(wanted, k, f"{against}; {np.count_nonzero(~good)} of {len(good)} frames are not")
        return self

    def _in_unit(self, text: str) -> str:
        return f"{text} {self.unit}".rstrip()

    def _some(self) -> None:
        __tracebackhide__ = True
        if not len(self.values):
            raise Unmet(f"frames with {self.name}", f"none by {seconds(self.bench.now_ns)}", [])

    def _fail(self, wanted: str, k: int, more: str) -> None:
        __tracebackhide__ = True
        seen = f"{self._in_unit(f'{self.values[k]:.6g}')} at {seconds(int(self.t_ns[k]))}{more}"
        raise Unmet(f"{self.name} {wanted}", seen, instants(self.bench.verdict))


class Bus:
    """The bus of a lap under way."""

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self._codec = bench.watch.codec

    @property
    def frames(self) -> list[Row]:
        """Every frame so far, in order: when it ended (live: left or came), ns, the frame, its node."""
        return self._bench.rows

    @property
    def load(self) -> float:
        """How much of the time the bus was busy, 0 to 1."""
        return self._bench.load

    @property
    def complaints(self) -> list[str]:
        """What is wrong with the bus so far, one line each; at its end it fails the test."""
        from bench.pytest_plugin.health import complaints

        return complaints(self._bench)

    def signal(self, name: str) -> Signal:
        """The signal `MESSAGE.signal` as far as the lap has been ridden; BusError if there is none."""
        of, _, key = name.partition(".")
        message = self._codec.message(of)
        if key not in message.signals:
            raise BusError(
                f"message {of} has no signal {key!r}; its signals are {', '.join(message.signals)}"
            )
        t_ns, values = self.decoded(message)
        return Signal(name, message.signals[key].unit, t_ns, values[key], self._bench)

    def decoded(self, message: Message) -> tuple[NDArray[np.int64], dict[str, NDArray[np.float64]]]:
        """Instants, ns, and physical values of every signal, of all frames of `message` so far."""
        rows = [
            (t_ns, frame.data)
            for t_ns, frame, _ in self._bench.rows
            if (frame.id, frame.extended) == (message.id, message.extended)
            and len(frame.data) >= message.length
        ]
        data = b"".join(payload[: message.length] for _, payload in rows)
        payloads = np.frombuffer(data, dtype=np.uint8).reshape(len(rows), message.length)
        t_ns = np.array([t for t, _ in rows], dtype=np.int64)
        return t_ns, self._codec.decode_all(message.name, payloads)

    def seen(self) -> list[Message]:
        """The messages of the DBC of which there was a frame, in its order."""
        keys = {(frame.id, frame.extended) for _, frame, _ in self._bench.rows}
        return [message for message in self._codec.messages() if (message.id, message.extended) in keys]
