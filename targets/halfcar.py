"""The half-car soft sensor of section II.4: the rear stroke from fork stroke and pitch rate by geometry.

Belongs here: the baseline a trained soft sensor is compared with (Figure III.16), on plain arrays. Never: a
lap, a motorcycle's data sheet, a network.

Of a rigid body on two struts, nose down by phi, equation (II.2) says P_rear = P_front + interaxle sin(phi)
with phi the integral of the pitch rate. That holds for *heights* of the body, phi being positive in braking
as (II.1) wants it. Strokes are compressions: what they measure from the body's height downwards grows where
the height falls, so that for them the sign of the interaxle turns:

    P_rear = P_front - interaxle sin(phi),  phi positive nose down
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite, pi

import numpy as np
from numpy.typing import ArrayLike, NDArray

from targets.errors import CalibrationError, TrainingError
from targets.narx.sequences import Sequences

Floats = NDArray[np.float64]

FORK, PITCH_RATE = "fork_stroke_mm", "pitch_rate_dps"

CORNER_HZ = 0.7
"""Corner of the high-pass on phi.

The thesis says nothing of one, but the integral of a gyroscope drifts: a zero-rate level of 0.1 deg/s is 0.4
degrees after 4 s, 10 mm over a wheelbase of 1.4 m. Chapter IV has the same illness with the integral of an
acceleration, treats it with a first-order high-pass, and settles on 0.7 Hz (section IV.2). That also takes
out the road's grade, which phi contains and the strokes do not (section II.4). `fitted` finds 0.74 Hz on
simulated training laps.
"""

CORNERS_HZ = (0.01, 10.0)
"""Where `fitted` looks for the corner: periods between 100 s and a tenth of a second."""


@dataclass(frozen=True)
class HalfCar:
    """The half-car soft sensor (II.2): P_rear = fork_gain P_front + pitch_gain_mm sin(phi) + offset_mm.

    pitch_gain_mm: mm of rear stroke for sin(phi) = 1, negative where the pitch rate is positive nose down.
    fork_gain: mm of rear stroke for one of fork stroke. corner_hz: of the first-order high-pass on phi; 0 is
    none. rate_hz: of the channels.
    Raises CalibrationError for a parameter that is not finite, a corner below 0, a rate not above 0.
    """

    pitch_gain_mm: float
    fork_gain: float
    corner_hz: float
    offset_mm: float
    rate_hz: float = 100.0

    def __post_init__(self) -> None:
        for name in ("pitch_gain_mm", "fork_gain", "corner_hz", "offset_mm", "rate_hz"):
            if not isfinite(getattr(self, name)):
                raise CalibrationError(f"half-car {name} is {getattr(self, name)}")
        if self.corner_hz < 0.0 or self.rate_hz <= 0.0:
            raise CalibrationError(
                f"half-car corner of {self.corner_hz} Hz at a rate of {self.rate_hz} Hz: at least 0, above 0"
            )

    def predict(self, channels: Mapping[str, ArrayLike]) -> Floats:
        """Predict the rear stroke, mm (T,), from `fork_stroke_mm` and `pitch_rate_dps`, (T,) each.

        It begins at phi = 0, as on the stand; further channels are not looked at. A run's first seconds
        (three of them with 0.7 Hz are plenty) carry the error of that assumption.
        Raises CalibrationError for a channel that is missing, not finite, or not as long as the other.
        """
        fork, rate = _channels(channels)
        sine = np.sin(pitch(rate, self.corner_hz, self.rate_hz))
        # (II.2), signs and ratios in the gains
        return self.fork_gain * fork + self.pitch_gain_mm * sine + self.offset_mm


def pitch(pitch_rate_dps: ArrayLike, corner_hz: float, rate_hz: float) -> Floats:
    """Pitch angle in radians (T,): the integral of (II.2) through a first-order high-pass at `corner_hz`.

    phi(s) = 1/s * s/(s + w) * rate(s) = rate(s) / (s + w) with w = 2 pi corner, by the trapezoidal rule, from
    phi(0) = 0. With corner 0 it is the published integral, which keeps every drift.
    """
    from scipy.signal import lfilter

    rate = np.radians(np.asarray(pitch_rate_dps, dtype=np.float64))
    if not rate.size:
        return rate
    w = 2.0 * pi * corner_hz
    # phi(t) = ((2 - w dt) phi(t-1) + dt (rate(t) + rate(t-1))) / (2 + w dt)
    dt = 1.0 / rate_hz
    b = dt / (2.0 + w * dt)
    phi, _ = lfilter([b, b], [1.0, -(2.0 - w * dt) / (2.0 + w * dt)], rate, zi=[-b * rate[0]])
    return phi


def rigid(
    data: Sequences,
    interaxle_mm: float,
    fork_ratio: float = 1.0,
    rear_ratio: float = 1.0,
    corner_hz: float = CORNER_HZ,
    washout: int = 100,
) -> HalfCar:
    """Return the half-car sensor by the equations alone; only its offset is taken from `data`.

    interaxle_mm: wheelbase; negative if the pitch rate is positive nose up, or for (II.2) with the sign it is
    printed with. fork_ratio, rear_ratio: mm a sensor moves for one of vertical wheel travel: a fork's lies
    along the leg (1 / cos of the caster angle), a rear one has its lever; 1 takes strokes for heights, as
    (II.2) does. offset: what makes the mean error 0 over the runs, their first `washout` samples not counted.
    Raises TrainingError for ratios not above 0, an interaxle of 0, and data without the two channels.
    """
    if not (fork_ratio > 0.0 and rear_ratio > 0.0 and interaxle_mm != 0.0):
        raise TrainingError(
            f"half-car: interaxle {interaxle_mm} mm, fork ratio {fork_ratio}, rear ratio {rear_ratio}: "
            f"none may be 0, the ratios are positive"
        )
    # P_rear / rear_ratio = P_front / fork_ratio - interaxle sin(phi) + constant
    gains = -rear_ratio * interaxle_mm, rear_ratio / fork_ratio
    fork, rates, measured = _counted(data, washout)
    sine = _sine(rates, corner_hz, data.rate_hz, washout)
    offset = float(np.mean(measured - gains[0] * sine - gains[1] * fork))
    return HalfCar(*gains, corner_hz, offset, data.rate_hz)


def fitted(data: Sequences, relative: bool = True, floor: float = 1.0, washout: int = 100) -> HalfCar:
    """Return the half-car sensor whose gains, corner and offset make the least squares on `data`.

    For a fair comparison: what the structure of (II.2) can do once it is trained as a network is.
    relative: errors are divided by the measured stroke, or by `floor` mm where that is less, as
    `narx.settings.Settings` has it; else plain mm. The corner is sought within CORNERS_HZ, and below a tenth
    of the rate, on a grid and then about its best point; the others follow from it by linear least squares.
    Raises TrainingError for data without the two channels or with a run no longer than `washout`.
    """
    from scipy.optimize import minimize_scalar

    if not floor > 0.0:
        raise TrainingError(f"half-car: floor is {floor} mm, more than 0 is needed")
    fork, rates, measured = _counted(data, washout)
    weight = 1.0 / np.maximum(np.abs(measured), floor) if relative else np.ones(len(measured))
    low, high = CORNERS_HZ
    grid = np.linspace(np.log(low), np.log(max(min(high, data.rate_hz / 10.0), 2.0 * low)), 16)

    def columns(log_corner: float) -> Floats:
        sine = _sine(rates, float(np.exp(log_corner)), data.rate_hz, washout)
        return np.stack([sine, fork, np.ones(len(fork)), measured], axis=1) * weight[:, None]

    def cost(log_corner: float) -> float:
        # |A p - y|^2 = y'y - y'A p where A'A p = A'y; columns of length 1 keep A'A well conditioned
        X = columns(log_corner)
        X /= np.sqrt(np.einsum("ij,ij->j", X, X)) + np.finfo(float).tiny
        G = X.T @ X
        return float(G[3, 3] - G[3, :3] @ np.linalg.lstsq(G[:3, :3], G[:3, 3], rcond=None)[0])

    best = int(np.argmin([cost(point) for point in grid]))
    bounds = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
    found = float(minimize_scalar(cost, bounds=bounds, method="bounded", options={"xatol": 1e-3}).x)
    X = columns(found)
    pitch_gain, fork_gain, offset = np.linalg.lstsq(X[:, :3], X[:, 3], rcond=None)[0].tolist()
    return HalfCar(pitch_gain, fork_gain, float(np.exp(found)), offset, data.rate_hz)


def _channels(channels: Mapping[str, ArrayLike]) -> tuple[Floats, Floats]:
    for name in (FORK, PITCH_RATE):
        if name not in channels:
            raise CalibrationError(f"half-car: no {name} among {', '.join(channels) or '(no channel)'}")
    fork, rate = (np.asarray(channels[name], dtype=np.float64) for name in (FORK, PITCH_RATE))
    if fork.ndim != 1 or fork.shape != rate.shape:
        raise CalibrationError(f"half-car: {FORK} has shape {fork.shape}, {PITCH_RATE} {rate.shape}")
    for name, values in ((FORK, fork), (PITCH_RATE, rate)):
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            raise CalibrationError(f"half-car: {name} is {values[bad[0]]} at sample {bad[0]}")
    return fork, rate


def _counted(data: Sequences, washout: int) -> tuple[Floats, list[Floats], Floats]:
    """Fork stroke of what counts of all runs, the whole pitch rate of each, the output of what counts."""
    for name in (FORK, PITCH_RATE):
        if name not in data.inputs:
            raise TrainingError(f"half-car: no {name} among {', '.join(data.inputs)}")
    for k, (_, y) in enumerate(data.runs):
        if len(y) <= washout:
            raise TrainingError(f"half-car: sequence {k} has {len(y)} samples, the washout is {washout}")
    fork, rate = data.inputs.index(FORK), data.inputs.index(PITCH_RATE)
    return (
        np.concatenate([u[washout:, fork] for u, _ in data.runs]),
        [u[:, rate] for u, _ in data.runs],
        np.concatenate([y[washout:] for _, y in data.runs]),
    )


def _sine(rates: list[Floats], corner_hz: float, rate_hz: float, washout: int) -> Floats:
    """sin(phi) of what counts of all runs; the integral begins anew in each."""
    return np.concatenate([np.sin(pitch(rate, corner_hz, rate_hz)[washout:]) for rate in rates])
