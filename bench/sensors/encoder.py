"""The wheel speed sensor: from speed to tooth pulses, and from the time between two back to speed.

Belongs here: the ring, the pulses, the timer and the rule when none comes. Never: a figure, rounding and
saturation (the transducer's), slip.

The rule: the speed is the nominal pitch over the time between the last two pulses, held to the next. Once a
pulse is overdue it is the pitch over the time since the last one: the speed cannot be more. Without a pulse
for the timeout the wheel stands: 0, until two pulses have come again.
FIDELITY: edges are seen without jitter, whatever gap and temperature; the wheel does not slip and does not
grow with speed; rolling backward gives the same pulses. Before the lap it rolled at the lap's first speed.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.sensors.parts import Encoder
from bench.sensors.streams import Draw
from bench.sensors.transducers import Transducer
from targets.jit import njit

KMH_PER_MS = 3.6


def read(
    transducer: Transducer,
    part: Encoder,
    t_ns: NDArray[np.int64],
    speed_kmh: NDArray[np.float64],
    draw: Draw,
) -> NDArray[np.float64]:
    """Codes before rounding, float64 (samples,), of true speeds; half to one and a half periods late."""
    pitch_kmh = part.circumference_m / part.teeth * KMH_PER_MS
    ring = draw("ring")
    edges = tooth_edges(part, ring)
    rate = np.abs(speed_kmh)
    rate /= pitch_kmh
    times = pulses(t_ns, rate, edges, ring.uniform() * part.teeth)
    read_kmh: NDArray[np.float64] = readings(t_ns, times, part.tick_s, part.timeout_s)
    read_kmh *= pitch_kmh * (1.0 + part.circumference * draw("circumference").standard_normal())
    return transducer.exact(read_kmh)


def tooth_edges(part: Encoder, random: np.random.Generator) -> NDArray[np.float64]:
    """Places of the teeth's edges in pitches, float64 (teeth + 1,): the last is the first, a turn later."""
    tooth = np.arange(part.teeth)
    turn = 2.0 * np.pi * (tooth / part.teeth + random.uniform())
    edges = tooth + part.edge_error * random.standard_normal(part.teeth) + part.runout * np.sin(turn)
    return np.append(edges, edges[0] + part.teeth)


def pulses(
    t_ns: NDArray[np.int64],
    pitches_per_s: NDArray[np.float64],
    edges: NDArray[np.float64],
    start: float,
) -> NDArray[np.float64]:
    """Times of the pulses, float64 seconds (pulses,), while the wheel turns from `start` (pitches) on.

    pitches_per_s: float64 (samples,), not negative, straight between two samples. The first two pulses lie
    before the lap (at minus infinity if the wheel stood).
    """
    # A tooth out of its place comes earlier or later, none is added.
    astray = np.ptp(edges - np.arange(len(edges)))
    times = np.empty(int(_way(t_ns, pitches_per_s) + 2.0 * astray) + 8)
    count = _pulses(t_ns, pitches_per_s, edges, start, times)
    return times[:count]


@njit(cache=True)
def _way(t_ns: Any, rate: Any) -> float:
    way = 0.0
    for i in range(len(t_ns) - 1):
        way += 0.5e-9 * (rate[i] + rate[i + 1]) * (t_ns[i + 1] - t_ns[i])
    return way


@njit(cache=True)
def _pulses(t_ns: Any, rate: Any, edges: Any, start: float, times: Any) -> int:
    teeth = len(edges) - 1
    place = edges[0] + start  # within one turn from the first edge
    k = 0
    while k < teeth - 1 and edges[k + 1] <= place:
        k += 1
    before = edges[k] - (edges[k - 1] if k > 0 else edges[teeth - 1] - teeth)
    if rate[0] > 0.0:
        times[1] = -(place - edges[k]) / rate[0]
        times[0] = times[1] - before / rate[0]
    else:
        times[0] = times[1] = -np.inf
    count = 2
    k += 1  # the next edge
    for i in range(len(t_ns) - 1):
        now = t_ns[i] * 1e-9
        step = (t_ns[i + 1] - t_ns[i]) * 1e-9
        a = (rate[i + 1] - rate[i]) / step
        ahead = place + 0.5 * (rate[i] + rate[i + 1]) * step
        while edges[k] <= ahead:
            # way = v t + a t^2 / 2, solved so that a of either sign, or none, loses no digits
            way = edges[k] - place
            root = math.sqrt(max(rate[i] * rate[i] + 2.0 * a * way, 0.0))
            if way > 0.0:
                times[count] = now + min(2.0 * way / (rate[i] + root), step)
            else:
                times[count] = now
            count += 1
            k += 1
            if k > teeth:
                k = 1
                place -= teeth
                ahead -= teeth
        place = ahead
    return count


@njit(cache=True)
def readings(t_ns: Any, times: Any, tick_s: float, timeout_s: float) -> Any:
    """Pitches per second at each sample, float64 (samples,), of pulses at `times` by the rule above."""
    out = np.empty(len(t_ns))
    last = np.floor(times[0] / tick_s) * tick_s if times[0] > -np.inf else -np.inf
    period = np.inf
    k = 1
    for i in range(len(t_ns)):
        now = t_ns[i] * 1e-9
        while k < len(times) and times[k] <= now:
            if times[k] > -np.inf:
                captured = np.floor(times[k] / tick_s) * tick_s
                period = max(captured - last, tick_s)
                if period > timeout_s:
                    period = np.inf  # the wheel stood in between: no speed yet
                last = captured
            k += 1
        waited = now - last
        if waited > timeout_s:
            period = np.inf
        out[i] = 1.0 / max(period, waited)
        if period == np.inf:
            out[i] = 0.0
    return out
