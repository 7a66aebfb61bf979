"""What the bench sends of one lap while faults come and go. Sans-I/O.

The frames of a whole lap are known beforehand; a fault that is fired during the replay is another plan of the
same lap, equal to the one before up to that instant, because faults are causal.
Belongs here: the plans. Never: who asks for a fault (panel), a clock, a bus.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from bench.codec import Codec
from bench.faults.bus import strike
from bench.faults.insertion import Insertion, insert, merged, split
from bench.faults.spec import FaultSpec
from bench.mdlog.feed import Feed
from bench.mdlog.logger import Schedule, schedule
from bench.sensors.codes import Codes


@dataclass(frozen=True)
class Plan:
    """One lap under `specs`: what the sensors say, what each fault did, and the frames of it all."""

    specs: Sequence[FaultSpec]
    codes: Codes
    insertions: Sequence[Insertion]
    frames: Schedule


class Script(Feed):
    """The frames of a lap with sensor codes `codes`, to be taken one after the other.

    codes: without any fault. specs: the faults planned beforehand. rate_hz: of every message, None for the
    DBC's own. Raises FaultError for a fault the lap cannot have, LapError for a rate that is none.
    """

    def __init__(
        self, codes: Codes, codec: Codec, specs: Iterable[FaultSpec] = (), rate_hz: int | None = None
    ) -> None:
        self.healthy, self.codec = codes, codec
        self._rate_hz = rate_hz
        self.now = self.plan(specs)
        super().__init__(self.now.frames)

    def plan(self, specs: Iterable[FaultSpec]) -> Plan:
        """The lap under `specs` in place of the faults so far; changes nothing, any thread may ask."""
        specs = tuple(specs)
        on_sensors, on_bus = split(specs)
        codes, inserted = insert(self.healthy, on_sensors)
        frames, struck = strike(schedule(codes, self.codec, self._rate_hz), on_bus, self.codec)
        return Plan(specs, codes, merged(specs, inserted, struck), frames)

    def excuses(self, t_ns: int) -> bool:
        """Whether a fault of the bus acts, or acted until a cycle ago."""
        return any(
            spec.on_bus
            and (acted.t_active_ns is not None and acted.t_active_ns <= t_ns + self.cycle_ns)
            and (acted.t_end_ns is None or t_ns <= acted.t_end_ns + self.cycle_ns)
            for spec, acted in zip(self.now.specs, self.now.insertions, strict=True)
        )

    def follow(self, plan: Plan, since_ns: int) -> bool:
        """Go on with `plan`, which differs from the present one from `since_ns` on; False if that is past."""
        if since_ns <= self.taken_ns:
            return False
        self.now = plan
        self.go_on_with(plan.frames)
        return True
