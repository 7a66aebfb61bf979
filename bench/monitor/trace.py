"""The recent past of one message's signals, in bounded memory.

Payloads are kept as they came and decoded many at once, when somebody looks or enough have gathered: so that
a frame costs next to nothing while it is read.
"""

import numpy as np
from numpy.typing import NDArray

from bench.codec import Codec, Message
from bench.monitor.counters import AliveCounter

BIN_NS = 50_000_000
BINS = 400
"""What is remembered: lowest, highest and mean value of each 50 ms of the last 20 s."""

_MOST_PENDING = 1024

Values = NDArray[np.float64]


class Trace:
    """The signals of `message`, and its alive counter if it has one (`counter`, else None).

    last: the latest value of each signal, empty before the first frame.
    """

    def __init__(self, codec: Codec, message: Message) -> None:
        self._codec, self._message = codec, message
        self._times: list[int] = []
        self._payloads = bytearray()
        self._names = tuple(message.signals)
        shape = (len(self._names), BINS)
        self._low, self._high = np.full(shape, np.inf), np.full(shape, -np.inf)
        self._sum, self._count = np.zeros(shape), np.zeros(BINS, dtype=np.int64)
        self._newest = -1  # the number of the latest bin that is ready to be filled
        alive = message.signals.get("alive")
        self.counter = AliveCounter(alive.length) if alive else None
        self.last: dict[str, float] = {}

    def add(self, t_ns: int, data: bytes) -> None:
        """A payload of the message's length, heard at `t_ns`, no earlier than the one before."""
        if not self._names:
            return
        self._times.append(t_ns)
        self._payloads += data
        if len(self._times) >= _MOST_PENDING:
            self.fold(t_ns)

    def fold(self, now_ns: int) -> None:
        """Decode what has gathered, and forget what lies BINS before `now_ns`."""
        self._advance(now_ns // BIN_NS)
        if not self._times:
            return
        t_ns = np.array(self._times, dtype=np.int64)
        payload = np.frombuffer(bytes(self._payloads), dtype=np.uint8).reshape(len(t_ns), -1)
        self._times.clear()
        self._payloads.clear()
        raw = self._codec.unpack(self._message.name, payload)
        if self.counter:
            self.counter.feed(t_ns, raw["alive"])
        bins = t_ns // BIN_NS
        recent = bins > self._newest - BINS
        place = bins[recent] % BINS
        np.add.at(self._count, place, 1)
        for k, name in enumerate(self._names):
            values = self._message.signals[name].to_physical(raw[name])
            self.last[name] = float(values[-1])
            np.add.at(self._sum[k], place, values[recent])
            np.minimum.at(self._low[k], place, values[recent])
            np.maximum.at(self._high[k], place, values[recent])

    def span(self, name: str) -> tuple[float, float]:
        """Lowest and highest value of signal `name` in the time remembered, NaN without a frame."""
        k = self._names.index(name)
        low, high = float(self._low[k].min()), float(self._high[k].max())
        return (low, high) if low <= high else (np.nan, np.nan)

    def means(self, name: str) -> Values:
        """Mean of signal `name` in each bin, float64 (BINS,), the latest last; NaN where no frame came."""
        order = np.arange(self._newest + 1, self._newest + 1 + BINS) % BINS
        count = self._count[order]
        total = self._sum[self._names.index(name)][order]
        return np.divide(total, count, out=np.full(BINS, np.nan), where=count > 0)

    def _advance(self, newest: int) -> None:
        for number in range(max(self._newest + 1, newest - BINS + 1), newest + 1):
            place = number % BINS
            self._low[:, place], self._high[:, place] = np.inf, -np.inf
            self._sum[:, place] = 0.0
            self._count[place] = 0
        self._newest = max(self._newest, newest)
