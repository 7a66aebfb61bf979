"""When a fault begins or ends, other than at a time: in a sector of the lap, on a condition, at random.

Belongs here: the three as they are written, and checking them. Never: a lap (`resolve`), a fault.

    sector=K/N                    when sector K of N equal ones is entered
    when=CHANNEL>VALUE[,for=S]    when the channel's true value has been so for S seconds (>, <, >=, <=)
    random=A..B[,seed=N]          at an instant drawn from A to B seconds
"""

import re
from collections.abc import Callable
from dataclasses import dataclass

from bench.errors import FaultError
from bench.faults.written import nanoseconds, seconds
from bench.nearest import unknown
from dbc import CHANNELS

_MOST_SECTORS = 10_000
_LARGEST = 1e6
_DECIMALS = 9
_CONDITION = re.compile(r"([a-z0-9_]*)(>=|<=|>|<)(.*)", re.DOTALL)
_DECIMAL = re.compile(r"-?[0-9]{1,7}(\.[0-9]{1,9})?")
_WHOLE = re.compile(r"[0-9]{1,10}")


@dataclass(frozen=True)
class Sector:
    """Sector `number` (1 to `of`) of a lap cut into `of` equal distances."""

    number: int
    of: int

    def __post_init__(self) -> None:
        if not 1 <= self.of <= _MOST_SECTORS:
            raise FaultError(f"sector={self.number}/{self.of}: a lap has 1 to {_MOST_SECTORS} sectors")
        if not 1 <= self.number <= self.of:
            raise FaultError(f"sector={self.number}/{self.of}: the sectors are 1 to {self.of}")

    def __str__(self) -> str:
        return f"sector={self.number}/{self.of}"


@dataclass(frozen=True)
class When:
    """The first instant at which `channel` has been `than` (>, <, >=, <=) `value` for `for_ns`."""

    channel: str
    than: str
    value: float
    for_ns: int = 0

    def __post_init__(self) -> None:
        if self.channel not in CHANNELS:
            raise FaultError(unknown("channel", self.channel, CHANNELS))
        if self.than not in (">", "<", ">=", "<="):
            raise FaultError(f"comparison {self.than!r} is none of >, <, >=, <=")
        # a comparison with NaN is false, and so refuses it
        if not -_LARGEST <= self.value <= _LARGEST:
            raise FaultError(f"when={self.channel}{self.than}{self.value}: beyond {_LARGEST:g}")
        if self.for_ns < 0:
            raise FaultError(f"when={self.channel}: for {self.for_ns} ns is below zero")
        object.__setattr__(self, "value", round(self.value, _DECIMALS) + 0.0)

    def __str__(self) -> str:
        value = f"{self.value:.{_DECIMALS}f}".rstrip("0").rstrip(".")
        hold = f",for={seconds(self.for_ns)}" if self.for_ns else ""
        return f"when={self.channel}{self.than}{value}{hold}"


@dataclass(frozen=True)
class Random:
    """An instant drawn evenly from low_ns <= t < high_ns."""

    low_ns: int
    high_ns: int
    seed: int = 0

    def __post_init__(self) -> None:
        if not 0 <= self.low_ns < self.high_ns:
            raise FaultError(f"{self}: the second instant must come after the first")
        if not 0 <= self.seed < 2**32:
            raise FaultError(f"{self}: a seed is 0 to {2**32 - 1}")

    def __str__(self) -> str:
        seed = f",seed={self.seed}" if self.seed else ""
        return f"random={seconds(self.low_ns)}..{seconds(self.high_ns)}{seed}"


Trigger = Sector | When | Random


def parse_trigger(text: str, spec: str) -> Trigger | None:
    """The trigger `text` of the fault `spec`; None if it does not begin as one. Raises FaultError."""
    name, equals, rest = text.partition("=")
    readers: dict[str, Callable[[str, str], Trigger]] = {"sector": _sector, "when": _when, "random": _random}
    return readers[name](rest, spec) if equals and name in readers else None


def _sector(text: str, spec: str) -> Sector:
    number, slash, of = text.partition("/")
    if not (slash and _WHOLE.fullmatch(number) and _WHOLE.fullmatch(of)):
        raise FaultError(f"sector {text!r} in {spec!r} is not K/N, as 3/8")
    return Sector(int(number), int(of))


def _when(text: str, spec: str) -> When:
    condition, *options = text.split(",")
    match = _CONDITION.fullmatch(condition)
    if not match:
        raise FaultError(f"condition {condition!r} in {spec!r} is not CHANNEL>VALUE (or <, >=, <=)")
    channel, than, value = match.groups()
    if not _DECIMAL.fullmatch(value):
        raise FaultError(f"value {value!r} in {spec!r} is not a plain decimal")
    given = _options(options, ("for",), spec)
    hold_ns = nanoseconds(given["for"], "for", spec) if "for" in given else 0
    return When(channel, than, float(value), hold_ns)


def _random(text: str, spec: str) -> Random:
    window, *options = text.split(",")
    low, dots, high = window.partition("..")
    if not dots:
        raise FaultError(f"window {window!r} in {spec!r} is not A..B, as 20..120")
    given = _options(options, ("seed",), spec)
    if "seed" in given and not _WHOLE.fullmatch(given["seed"]):
        raise FaultError(f"seed {given['seed']!r} in {spec!r} is not a whole number")
    return Random(
        nanoseconds(low, "time", spec), nanoseconds(high, "time", spec), int(given.get("seed", "0"))
    )


def _options(parts: list[str], known: tuple[str, ...], spec: str) -> dict[str, str]:
    given: dict[str, str] = {}
    for part in parts:
        name, equals, value = part.partition("=")
        if not equals or name not in known:
            raise FaultError(f"{part!r} in {spec!r} is not {known[0]}=VALUE")
        if name in given:
            raise FaultError(f"{name} in {spec!r} is given twice")
        given[name] = value
    return given
