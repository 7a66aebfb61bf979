"""The monitor: frames in, one look at the bus out. Sans-I/O; memory does not grow with time.

Belongs here: what is counted and kept of each message. Never: a bus, a screen, a key.
"""

from bench.bus.bits import INTERMISSION_BITS, frame_bits
from bench.codec import Codec, Message
from bench.monitor.detection import Detection
from bench.monitor.ecu import EcuState
from bench.monitor.rows import EcuRow, Look, MessageRow, SignalRow
from bench.monitor.trace import Trace
from bench.monitor.window import LastSecond
from bench.watch import STATUS
from targets.ecu import Frame

_MOST_UNKNOWN_IDS = 1024
_TWO_SENDERS = 8
"""So many errors of a counter, and one in two frames: it is counted up by two."""

_NO_CURVE = frozenset({"alive"})
_ECU_NUMBERS = frozenset({"alarm", "ready", "step", "kind", "step_cycles", "missed_inputs", "overruns"})
"""Signals that no curve is drawn of: they are shown as counters, or with the ECU."""


class _Line:
    """One message of the bus, as far as it was heard."""

    def __init__(self, codec: Codec, message: Message) -> None:
        self.message = message
        self.trace = Trace(codec, message)
        self.window = LastSecond()
        self.frames = self.wrong = self.wrong_length = 0
        self.first_ns = self.last_ns = 0

    def mean_per_s(self) -> float:
        lasted_ns = self.last_ns - self.first_ns
        return (self.frames - 1) / (lasted_ns / 1e9) if lasted_ns else 0.0


class Monitor:
    """Listens to a bus of `bitrate` whose messages `codec` knows.

    clock_hz: of the ECUs' CPU. threshold_pct: of the IFD's residual, None if it is not known.
    detection: to be told what the replay tells. dropped: to be set where the kernel counts.
    """

    def __init__(
        self,
        codec: Codec,
        bitrate: int = 500_000,
        clock_hz: float = 22e6,
        threshold_pct: float | None = None,
    ) -> None:
        self._codec, self._bitrate = codec, bitrate
        self._known = {(m.id, m.extended): m for m in codec.messages()}
        self._lines: dict[tuple[int, bool], _Line] = {}
        self._frames, self._bits = LastSecond(), LastSecond()
        self._unknown_ids: set[tuple[int, bool]] = set()
        self._t_ns = 0
        names = {m.name for m in codec.messages()}
        self._ecus = {
            role: EcuState(codec, role, clock_hz, threshold_pct if role == "ifd" else None)
            for role in STATUS
            if names.issuperset(EcuState.messages(role))
        }
        self._sender = {name: role for role in self._ecus for name in EcuState.messages(role)}
        self.detection = Detection()
        self.frames = self.unknown = self.worst_age_ns = 0
        self.dropped: int | None = None

    def heard(self, t_ns: int, frame: Frame, age_ns: int = 0) -> None:
        """A frame that ended at `t_ns`, read `age_ns` later; time never runs backwards here."""
        t_ns = self._t_ns = max(t_ns, self._t_ns)
        self.frames += 1
        self.worst_age_ns = max(self.worst_age_ns, age_ns)
        self._frames.add(t_ns)
        self._bits.add(t_ns, frame_bits(*frame) + INTERMISSION_BITS)
        key = frame.id, frame.extended
        line = self._lines.get(key) or self._new(key, t_ns)
        if line is None:
            self.unknown += 1
            if len(self._unknown_ids) < _MOST_UNKNOWN_IDS:
                self._unknown_ids.add(key)
            return
        line.frames += 1
        line.last_ns = t_ns
        line.window.add(t_ns)
        if len(frame.data) != line.message.length:
            line.wrong += 1
            line.wrong_length = len(frame.data)
            return
        line.trace.add(t_ns, frame.data)
        role = self._sender.get(line.message.name)
        if role:
            self._ecus[role].heard(t_ns, frame)

    def look(self, now_ns: int) -> Look:
        """What there is to see at `now_ns`."""
        now_ns = max(now_ns, self._t_ns)
        lines = sorted(self._lines.values(), key=lambda line: (line.message.extended, line.message.id))
        for line in lines:
            line.trace.fold(now_ns)
        messages = tuple(self._message(line, now_ns) for line in lines)
        return Look(
            t_ns=now_ns,
            frames=self.frames,
            per_s=self._frames.per_second(now_ns),
            load=self._bits.per_second(now_ns) / self._bitrate,
            bitrate=self._bitrate,
            signals=tuple(row for line in lines for row in self._signals(line, now_ns)),
            messages=messages,
            ecus=tuple(self._ecu(role, now_ns) for role, ecu in self._ecus.items() if ecu.heard_of),
            faults=tuple(self.detection.faults),
            unknown=self.unknown,
            unknown_ids=len(self._unknown_ids),
            dropped=self.dropped,
            worst_age_ns=self.worst_age_ns,
            complaints=tuple(self._complaints(messages)),
        )

    def _new(self, key: tuple[int, bool], t_ns: int) -> _Line | None:
        message = self._known.get(key)
        if message is None:
            return None
        line = self._lines[key] = _Line(self._codec, message)
        line.first_ns = t_ns
        return line

    def _message(self, line: _Line, now_ns: int) -> MessageRow:
        message, counter = line.message, line.trace.counter
        return MessageRow(
            name=message.name,
            id=message.id,
            extended=message.extended,
            length=message.length,
            frames=line.frames,
            per_s=line.window.per_second(now_ns),
            mean_per_s=line.mean_per_s(),
            due_per_s=1000 / message.cycle_ms if message.cycle_ms else None,
            lost=counter.lost if counter else None,
            repeats=counter.repeats if counter else None,
            restarts=counter.restarts if counter else None,
            wrong=line.wrong,
            wrong_length=line.wrong_length,
            age_ns=now_ns - line.last_ns,
        )

    def _signals(self, line: _Line, now_ns: int) -> list[SignalRow]:
        hidden = _NO_CURVE | _ECU_NUMBERS if line.message.name in self._sender else _NO_CURVE
        trace = line.trace
        return [
            SignalRow(
                message=line.message.name,
                name=name,
                unit=line.message.signals[name].unit,
                value=value,
                low=trace.span(name)[0],
                high=trace.span(name)[1],
                means=trace.means(name),
                age_ns=now_ns - line.last_ns,
            )
            for name, value in trace.last.items()
            if name not in hidden
        ]

    def _ecu(self, role: str, now_ns: int) -> EcuRow:
        ecu = self._ecus[role]
        status = self._codec.message(STATUS[role])
        line = self._lines.get((status.id, status.extended))
        alarm = ecu.alarm
        return ecu.row(
            now_ns,
            line.window.per_second(now_ns) if line else 0.0,
            self.detection.td_s(alarm.on_ns) if alarm and role == "ifd" else None,
        )

    def _complaints(self, messages: tuple[MessageRow, ...]) -> list[str]:
        dbc = self._codec.path.name
        lines = [
            f"{row.name} has {row.wrong_length} bytes, {dbc} says {row.length}: another DBC "
            f"({row.wrong} frames)"
            for row in messages
            if row.wrong
        ]
        lines += [
            f"{row.name}: its counter jumps, {row.lost} lost and {row.repeats} repeated: two senders?"
            for row in messages
            if (errors := (row.lost or 0) + (row.repeats or 0)) >= _TWO_SENDERS and 2 * errors >= row.frames
        ]
        if self.dropped:
            lines.append(f"{self.dropped} frames dropped by the kernel: read too slowly")
        return lines
