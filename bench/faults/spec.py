"""A fault as it is written: `PLACE:KIND[:PARAM=VALUE,...]@START[+END]`, times in seconds.

Belongs here: reading it, checking it, writing it back. Every refusal is one FaultError line that names the
value at fault and the ones that would do. Never: codes, laps, what a kind does.
"""

from collections.abc import Iterable
from dataclasses import dataclass

from bench.errors import FaultError
from bench.faults.kind import BusKind, Choice, Number, SensorKind, Value
from bench.faults.kinds import KINDS
from bench.faults.places import BUS, SENSORS, WHERE, messages, places
from bench.faults.trigger import Trigger, When, parse_trigger
from bench.faults.written import is_number, nanoseconds, seconds, value
from bench.nearest import unknown

FORM = "SENSOR:KIND[:PARAM=VALUE,...]@TIME[+DURATION]"


@dataclass(frozen=True)
class FaultSpec:
    """One fault of one place, from `t_cmd_ns` after the lap's start, for `duration_ns` or to the lap's end.

    sensor: its place: a sensor; for a bus fault a message's name, or "bus". params: every parameter of the
    kind with its value, in the table's order; those not given on construction get their default, so that two
    specs are equal if they mean the same fault. start: what it begins on instead of at t_cmd_ns, which then
    is 0; until: what it ends on instead of after duration_ns; `resolve` turns both into times. `str` gives
    the written form. Raises FaultError for what the tables do not know, and for times that are not.
    """

    sensor: str
    kind: str
    params: tuple[tuple[str, Value], ...] = ()
    t_cmd_ns: int = 0
    duration_ns: int | None = None
    start: Trigger | None = None
    until: When | None = None

    def __post_init__(self) -> None:
        _check_place(self.sensor, self.kind)
        where, begin_ns, lasts_ns = f"{self.sensor}:{self.kind}", self.t_cmd_ns, self.duration_ns
        if begin_ns < 0:
            raise FaultError(f"{where}: time {begin_ns} ns is before the lap's start")
        if lasts_ns is not None and lasts_ns <= 0:
            raise FaultError(f"{where}: duration {lasts_ns} ns is not positive")
        if self.start is not None and begin_ns:
            raise FaultError(f"{where}: begins at {begin_ns} ns and on {self.start}; it can have one")
        if self.until is not None and lasts_ns is not None:
            raise FaultError(f"{where}: ends after {lasts_ns} ns and on {self.until}; it can have one")
        object.__setattr__(self, "params", _complete(self.kind, self.params))

    @property
    def called(self) -> str | None:
        """What an ECU that names the kind of a fault should call this one, None if it has no name for it."""
        return KINDS[self.kind].called(dict(self.params))

    @property
    def ftb(self) -> int | None:
        """Its failure type byte (`bench.faults.ftb`), None if none fits."""
        return KINDS[self.kind].ftb(dict(self.params))

    @property
    def on_bus(self) -> bool:
        """Whether it acts on frames instead of a sensor's codes."""
        return isinstance(KINDS[self.kind], BusKind)

    @property
    def sensors(self) -> tuple[str, ...]:
        """Every sensor whose codes it changes; none for a fault of the bus."""
        kind = KINDS[self.kind]
        return (
            (self.sensor, *kind.also(self.sensor, dict(self.params))) if isinstance(kind, SensorKind) else ()
        )

    @property
    def resolved(self) -> bool:
        """Whether it begins and ends at plain times."""
        return self.start is None and self.until is None

    def __str__(self) -> str:
        known = KINDS[self.kind].params
        params = ",".join(f"{name}={value(v)}" for name, v in self.params if not _left_out(known[name], v))
        head = f"{self.sensor}:{self.kind}" + (f":{params}" if params else "")
        begin = self.start or seconds(self.t_cmd_ns)
        end = self.until or ("" if self.duration_ns is None else seconds(self.duration_ns))
        return f"{head}@{begin}" + (f"+{end}" if end else "")


def parse_fault(text: str) -> FaultSpec:
    """Read `PLACE:KIND[:PARAM=VALUE,...]@START[+END]`, e.g. `rear_stroke:open@60+5`.

    START is a time or a trigger, END a duration or `when=...` (see `trigger`). Times are plain decimals in
    seconds, to the nanosecond. Raises FaultError.
    """
    head, at, when = text.partition("@")
    if not at:
        raise FaultError(f"{text!r} has no @TIME; a fault is written {FORM}")
    place, _, rest = head.partition(":")
    kind, colon, params = rest.partition(":")
    begin, plus, end = when.partition("+")
    start = parse_trigger(begin, text)
    until = parse_trigger(end, text) if plus else None
    if until is not None and not isinstance(until, When):
        raise FaultError(f"{end!r} in {text!r}: a fault ends after a duration, or on when=")
    return FaultSpec(
        place,
        kind,
        tuple(_pairs(params, text)) if colon else (),
        nanoseconds(begin, "time", text) if start is None else 0,
        nanoseconds(end, "duration", text) if plus and until is None else None,
        start,
        until,
    )


def _check_place(place: str, kind: str) -> None:
    sensor = place in SENSORS
    # the DBC is read for what no sensor is named, and only then
    if not sensor and place not in (*messages(), BUS):
        raise FaultError(unknown("sensor", place, (*SENSORS, *messages(), BUS)))
    if kind not in KINDS:
        fitting = [name for name, row in KINDS.items() if isinstance(row, BusKind) != sensor]
        raise FaultError(unknown("kind", kind, fitting))
    where = KINDS[kind].where
    if place not in places(where):
        known = ", ".join(places(where))
        raise FaultError(f"{place}:{kind}: {kind} acts on {WHERE[where]}, not on {place}; write {known}")


def _pairs(params: str, text: str) -> Iterable[tuple[str, Value]]:
    for part in params.split(","):
        name, equals, given = part.partition("=")
        if not equals or not name:
            raise FaultError(f"{part!r} in {text!r} is not PARAM=VALUE; a fault is written {FORM}")
        yield name, given


def _complete(kind: str, given: Iterable[tuple[str, Value]]) -> tuple[tuple[str, Value], ...]:
    """All parameters of `kind`, checked, defaults filled in, in the table's order."""
    known = KINDS[kind].params
    values: dict[str, Value] = {}
    for name, each in given:
        if name not in known:
            takes = f"takes {', '.join(known)}" if known else "takes no parameter"
            raise FaultError(f"unknown parameter {name!r}; {kind} {takes}")
        if name in values:
            raise FaultError(f"parameter {name!r} of {kind} is given twice")
        values[name] = _check(f"{kind}:{name}", each, known[name])
    return tuple((name, values.get(name, known[name].default)) for name in known)


def _check(where: str, given: Value, rule: Number | Choice) -> Value:
    if isinstance(rule, Choice):
        if given not in rule.options:
            raise FaultError(f"{where}={given} is not one of {', '.join(rule.options)}")
        return given
    if isinstance(given, str) and not is_number(given):
        raise FaultError(f"{where}={given} is not a number")
    number = float(given)
    # a comparison with NaN is false, and so refuses it
    if not rule.low <= number <= rule.high:
        raise FaultError(f"{where}={given} is not within {rule.low:g} to {rule.high:g}")
    if rule.whole and not number.is_integer():
        raise FaultError(f"{where}={given} is not a whole number")
    return number + 0.0  # -0.0 becomes 0.0: one fault, one spelling


def _left_out(rule: Number | Choice, given: Value) -> bool:
    return rule.extra and given == rule.default
