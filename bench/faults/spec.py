"""A fault as it is written: `SENSOR:KIND[:PARAM=VALUE,...]@TIME[+DURATION]`, times in seconds.

Belongs here: reading it, checking it, writing it back. Every refusal is one FaultError line that names the
value at fault and the ones that would do. Never: codes, laps, what a kind does.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass

from bench.errors import FaultError
from bench.faults.kinds import KINDS, Choice, Number, Value
from bench.sensors.transducers import TRANSDUCERS

FORM = "SENSOR:KIND[:PARAM=VALUE,...]@TIME[+DURATION]"

_SECONDS = re.compile(r"([0-9]{1,9})(?:\.([0-9]{1,9}))?")
_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")


@dataclass(frozen=True)
class FaultSpec:
    """One fault of one sensor, from `t_cmd_ns` after the lap's start, for `duration_ns` or to the lap's end.

    params: every parameter of the kind with its value, in the table's order; those not given on construction
    get their default, so that two specs are equal if they mean the same fault. `str` gives the written form.
    Raises FaultError for what the tables do not know, and for times that are not.
    """

    sensor: str
    kind: str
    params: tuple[tuple[str, Value], ...] = ()
    t_cmd_ns: int = 0
    duration_ns: int | None = None

    def __post_init__(self) -> None:
        if self.sensor not in TRANSDUCERS:
            raise FaultError(f"unknown sensor {self.sensor!r}; the known ones are {', '.join(TRANSDUCERS)}")
        if self.kind not in KINDS:
            raise FaultError(f"unknown kind {self.kind!r}; the known ones are {', '.join(KINDS)}")
        if self.t_cmd_ns < 0:
            raise FaultError(f"{self.sensor}:{self.kind}: time {self.t_cmd_ns} ns is before the lap's start")
        if self.duration_ns is not None and self.duration_ns <= 0:
            raise FaultError(f"{self.sensor}:{self.kind}: duration {self.duration_ns} ns is not positive")
        object.__setattr__(self, "params", _complete(self.kind, self.params))

    @property
    def called(self) -> str | None:
        """What an ECU that names the kind of a fault should call this one, None if it has no name for it."""
        return KINDS[self.kind].called(dict(self.params))

    def __str__(self) -> str:
        known = KINDS[self.kind].params
        params = ",".join(
            f"{name}={_write(value)}" for name, value in self.params if not _left_out(known[name], value)
        )
        duration = "" if self.duration_ns is None else f"+{_seconds(self.duration_ns)}"
        head = f"{self.sensor}:{self.kind}" + (f":{params}" if params else "")
        return f"{head}@{_seconds(self.t_cmd_ns)}{duration}"


def parse_fault(text: str) -> FaultSpec:
    """Read `SENSOR:KIND[:PARAM=VALUE,...]@TIME[+DURATION]`, e.g. `rear_stroke:open@60+5`.

    Times are plain decimals in seconds, to the nanosecond. Raises FaultError.
    """
    head, at, when = text.partition("@")
    if not at:
        raise FaultError(f"{text!r} has no @TIME; a fault is written {FORM}")
    sensor, _, rest = head.partition(":")
    kind, colon, params = rest.partition(":")
    start, plus, duration = when.partition("+")
    return FaultSpec(
        sensor,
        kind,
        tuple(_pairs(params, text)) if colon else (),
        _nanoseconds(start, "time", text),
        _nanoseconds(duration, "duration", text) if plus else None,
    )


def _pairs(params: str, text: str) -> Iterable[tuple[str, Value]]:
    for part in params.split(","):
        name, equals, value = part.partition("=")
        if not equals or not name:
            raise FaultError(f"{part!r} in {text!r} is not PARAM=VALUE; a fault is written {FORM}")
        yield name, value


def _complete(kind: str, given: Iterable[tuple[str, Value]]) -> tuple[tuple[str, Value], ...]:
    """All parameters of `kind`, checked, defaults filled in, in the table's order."""
    known = KINDS[kind].params
    values: dict[str, Value] = {}
    for name, value in given:
        if name not in known:
            takes = f"takes {', '.join(known)}" if known else "takes no parameter"
            raise FaultError(f"unknown parameter {name!r}; {kind} {takes}")
        if name in values:
            raise FaultError(f"parameter {name!r} of {kind} is given twice")
        values[name] = _check(f"{kind}:{name}", value, known[name])
    return tuple((name, values.get(name, known[name].default)) for name in known)


def _check(where: str, value: Value, rule: Number | Choice) -> Value:
    if isinstance(rule, Choice):
        if value not in rule.options:
            raise FaultError(f"{where}={value} is not one of {', '.join(rule.options)}")
        return value
    if isinstance(value, str) and not _NUMBER.fullmatch(value):
        raise FaultError(f"{where}={value} is not a number")
    number = float(value)
    # a comparison with NaN is false, and so refuses it
    if not rule.low <= number <= rule.high:
        raise FaultError(f"{where}={value} is not within {rule.low:g} to {rule.high:g}")
    return number + 0.0  # -0.0 becomes 0.0: one fault, one spelling


def _nanoseconds(text: str, what: str, spec: str) -> int:
    match = _SECONDS.fullmatch(text)
    if not match:
        raise FaultError(
            f"{what} {text!r} in {spec!r} is not a non-negative plain decimal in seconds, to the nanosecond"
        )
    whole, fraction = match.groups()
    return int(whole) * 1_000_000_000 + int((fraction or "").ljust(9, "0"))


def _left_out(rule: Number | Choice, value: Value) -> bool:
    return isinstance(rule, Number) and rule.extra and value == rule.default


def _seconds(ns: int) -> str:
    whole, fraction = divmod(ns, 1_000_000_000)
    return f"{whole}.{fraction:09d}".rstrip("0").rstrip(".")


def _write(value: Value) -> str:
    # repr gives the fewest digits that read back as the same float
    return value if isinstance(value, str) else repr(value).removesuffix(".0")
