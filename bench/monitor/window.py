"""Sums over the last second, from instants that never run backwards."""

from collections import deque

_BIN_NS = 50_000_000
_BINS = 20  # one second


class LastSecond:
    """The sum of what was added in the last second; holds at most one number per 50 ms."""

    def __init__(self) -> None:
        self._bins: deque[list[int]] = deque(maxlen=_BINS + 1)

    def add(self, t_ns: int, amount: int = 1) -> None:
        """`amount` more at `t_ns`."""
        number = t_ns // _BIN_NS
        if self._bins and self._bins[-1][0] == number:
            self._bins[-1][1] += amount
        else:
            self._bins.append([number, amount])

    def per_second(self, now_ns: int) -> float:
        """The sum over the last whole 50 ms of a second at most, divided by their time.

        Before the first second is over: over the time since 0.
        """
        now = now_ns // _BIN_NS
        bins = min(now, _BINS)
        total = sum(amount for number, amount in self._bins if now - bins <= number < now)
        return total / (bins * _BIN_NS / 1e9) if bins else 0.0
