"""The faults of a replay that is over, as a campaign file that rides them again.

A campaign rides whole laps with one fault each: a fault of the k-th round of a part of a lap comes, there, at
the same place of the whole lap. Belongs here: the file's text. Never: what a campaign makes of it, options.
"""

import json
from dataclasses import dataclass, replace
from shlex import join

import numpy as np

from bench.faults.spec import FaultSpec
from bench.laps.lap import Lap
from bench.part import Part
from bench.printable import printable
from bench.script import Script


@dataclass(frozen=True)
class Session:
    """What was replayed: `part` of `lap`, in the file `name`, through `sensors` drawn from `seed`."""

    name: str
    lap: Lap
    part: Part
    sensors: str
    seed: int

    def toml(self, script: Script) -> str:
        """The campaign file of the faults that `script` ended with."""
        specs = script.now.specs
        faults = [
            f"{_text(f'{k} {spec.sensor}:{spec.kind}')} = {_text(str(self._whole_lap(spec, script)))}"
            for k, spec in enumerate(specs, 1)
        ]
        lines = [
            "# The faults of one session, each on the lap and at the instant at which it came:",
            "#     bench campaign run THIS.toml --laps FOLDER",
            f"# where FOLDER holds nothing but {printable(self.name)}. All in one ride, as they were:",
            "# the same `bench replay`, or for a whole lap `bench run`, with no fault but",
            f"#     {join(word for spec in specs for word in ('--fault', str(spec))) or 'none'}",
            'kind = "road"',
            f"title = {_text(f'Session on {self.name}'[:200])}",
            'stands_for = "no published table"',
            'route = "mixed_5km"          # every campaign names one; --laps takes its place',
            "laps = 1",
            f"sensors = {_text(self.sensors)}",
            f"seed = {self.seed}",
            "fault_window_s = [0, 0]      # no instant is drawn",
            "",
            "[faults]",
            *faults,
        ]
        return "\n".join(lines) + "\n"

    def _whole_lap(self, spec: FaultSpec, script: Script) -> FaultSpec:
        if self.part == Part():
            return spec
        t_ns = self.lap.t_ns - self.lap.t_ns[0]
        begin_ns = int(t_ns[np.searchsorted(t_ns, self.part.begin_ns)])
        replayed = script.healthy.t_ns
        samples = len(replayed) // self.part.loops
        in_round_ns = spec.t_cmd_ns
        if self.part.loops > 1:
            in_round_ns %= int(replayed[samples])
        return replace(spec, t_cmd_ns=begin_ns + in_round_ns)


def _text(text: str) -> str:
    return json.dumps(printable(text), ensure_ascii=False)
