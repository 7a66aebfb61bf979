"""Soft sensors on laps: what a network is trained on, and what it is compared with.

Belongs here: the way from laps to arrays, and the predictors that share it. Never: an iteration, a file.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.errors import LapError
from bench.laps.lap import Lap
from bench.mdlog.logger import sampled
from bench.plant.motorcycle import Motorcycle
from bench.sensors.codes import acquire
from bench.sensors.parts import Sensors
from bench.sensors.transducers import BY_CHANNEL
from dbc import CHANNELS
from targets.halfcar import HalfCar, fitted, rigid
from targets.narx import measures
from targets.narx.measures import Performance
from targets.narx.network import Narx
from targets.narx.prepare import RANGES, resampled
from targets.narx.sequences import Sequences
from targets.narx.settings import relative_suits

Floats = NDArray[np.float64]

INPUTS = ("fork_stroke_mm", "pitch_rate_dps", "speed_kmh")
"""What the thesis predicts the rear stroke from (section III.1)."""
OUTPUT = "rear_stroke_mm"
RATE_HZ = 100
WASHOUT = 100
"""Samples at the start of a run that count in no figure: the loop starts there (1 s)."""


def ranges() -> dict[str, tuple[float, float]]:
    """What every channel is normalised by: section III.3's ranges, a sensor's span where it has none."""
    spans = {name: (part.low, part.high) for name, part in BY_CHANNEL.items()}
    return {**spans, **RANGES}


def inputs_of(laps: Sequence[Lap], wanted: Sequence[str] | None, output: str = OUTPUT) -> tuple[str, ...]:
    """The inputs to train on: those `wanted`, else those of the thesis's that every lap has.

    Raises LapError naming the lap and channel for what is wanted and missing, and laps without any of them.
    """
    for lap in laps:
        lap.require((*(wanted or ()), output), "training")
    if wanted:
        for name in wanted:
            if name not in CHANNELS or name == output:
                known = ", ".join(channel for channel in CHANNELS if channel != output)
                raise LapError(f"input {name!r} is none of {known}")
        return tuple(wanted)
    shared = tuple(name for name in INPUTS if name != output and all(name in lap.channels for lap in laps))
    if not shared:
        raise LapError(f"no input that every lap has: training takes {', '.join(INPUTS)}, or --inputs")
    return shared


def sequences(
    laps: Sequence[Lap],
    sensors: Sensors,
    inputs: Sequence[str] = INPUTS,
    output: str = OUTPUT,
    antialias: bool = False,
) -> Sequences:
    """The laps as the ECU sees them: through sensors and logger, at 100 Hz.

    antialias: resample the 1 kHz codes through a zero-phase low-pass, as section III.2 does with recordings.
    """
    runs = []
    for lap in laps:
        lap.require((*inputs, output), "training")
        codes = acquire(lap, sensors)
        if antialias:
            every = sampled(codes, 1000)
            seen = {
                name: resampled(every[name], 1000.0, RATE_HZ, True, name).values for name in (*inputs, output)
            }
        else:
            seen = sampled(codes, RATE_HZ)
        runs.append((np.stack([seen[name] for name in inputs], axis=1), seen[output]))
    return Sequences(tuple(inputs), output, tuple(runs), float(RATE_HZ))


@dataclass(frozen=True)
class Predictor:
    """What predicts the output of some runs: its name and one prediction (T,) a run."""

    name: str
    predictions: tuple[Floats, ...]


def network(name: str, narx: Narx, data: Sequences) -> Predictor:
    """A network's free run; shifted ones begin with what their delay lines hold."""
    found = []
    for u, y in data.runs:
        ahead = np.full(narx.shift, narx.initial_mm)
        found.append(np.concatenate([ahead, narx.free_run(u)])[: len(y)])
    return Predictor(name, tuple(found))


def baselines(training: Sequences, data: Sequences, motorcycle: Motorcycle | None) -> list[Predictor]:
    """The half-car sensor of section II.4, by its equations and fitted, and the training laps' best constant.

    motorcycle: whose geometry the equations take; None where it is unknown. The half-car needs fork stroke
    and pitch rate; without them only the constant is left.
    """
    found = []
    if {"fork_stroke_mm", "pitch_rate_dps"} <= set(training.inputs):
        if motorcycle is not None:
            car = rigid(
                training, 1e3 * motorcycle.wheelbase_m, motorcycle.fork.sensor, _lever(training, motorcycle)
            )
            found.append(_half_car("half-car (II.2)", car, data))
        found.append(_half_car("half-car, fitted", fitted(training), data))
    every = np.concatenate([y[WASHOUT:] for _, y in training.runs])
    # the least Er (III.2), where errors can be divided by the output
    relative = relative_suits(training, ranges()[training.output])
    constant = measures.best_constant(every) if relative else float(np.mean(every))
    found.append(Predictor("best constant", tuple(np.full(len(y), constant) for _, y in data.runs)))
    return found


def _lever(training: Sequences, motorcycle: Motorcycle) -> float:
    """Sensor stroke per vertical wheel travel at the laps' mean rear stroke."""
    shock = motorcycle.shock
    mean_m = float(np.mean(np.concatenate([y for _, y in training.runs]))) / 1e3
    # stroke = (s + r w / 2) w, its slope s + r w = sqrt(s^2 + 2 r stroke)
    return float(np.sqrt(shock.sensor**2 + 2.0 * shock.sensor_rise_per_m * mean_m))


def _half_car(name: str, car: HalfCar, data: Sequences) -> Predictor:
    return Predictor(name, tuple(car.predict(dict(zip(data.inputs, u.T, strict=True))) for u, _ in data.runs))


def linear(training: Sequences, data: Sequences, taps: int) -> Predictor:
    """A finite impulse response of `taps` samples of every input and an offset, by least squares."""
    weights = np.linalg.lstsq(
        np.concatenate([_lags(u, taps)[WASHOUT:] for u, _ in training.runs]),
        np.concatenate([y[WASHOUT:] for _, y in training.runs]),
        rcond=None,
    )[0]
    return Predictor(f"linear FIR, {taps} taps", tuple(_lags(u, taps) @ weights for u, _ in data.runs))


def _lags(u: Floats, taps: int) -> Floats:
    """Rows (T, n_u taps + 1): each input now and at the taps - 1 samples before, and 1."""
    past = np.concatenate([np.repeat(u[:1], taps - 1, axis=0), u])
    columns = [past[taps - 1 - k : taps - 1 - k + len(u)] for k in range(taps)]
    return np.concatenate([*columns, np.ones((len(u), 1))], axis=1)


def pairs(predictor: Predictor, data: Sequences) -> list[tuple[Floats, Floats]]:
    """(predicted, measured) of each run."""
    return [(p, y) for p, (_, y) in zip(predictor.predictions, data.runs, strict=True)]


def performance(
    predictor: Predictor, data: Sequences, reference: Predictor | None = None, **kind: Any
) -> Performance:
    """The figures of `measures.performance`, the first second of every run not counted."""
    other = reference.predictions if reference else None
    return measures.performance(pairs(predictor, data), data.rate_hz, WASHOUT, other, **kind)
