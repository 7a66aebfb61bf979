"""Faults in a sensor's signal, whatever the sensor: the thesis's four, and offset, drift, noise, lateness.

Belongs here: what each kind does to codes. Never: a circuit (`electrical`), a frame (`frames`), times.
"""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from bench.faults.electrical import PULL
from bench.faults.kind import SEED, Acting, Choice, Codes, Kind, Number, SensorKind, always, byte

_BLOCK = 64

Floats = NDArray[np.float64]


def _open(fault: Acting) -> Codes:
    return fault.constant(fault.transducer.code_max)


def _short(fault: Acting) -> Codes:
    to_ground = fault.params["to"] == "gnd"
    return fault.constant(fault.transducer.code_min if to_ground else fault.transducer.code_max)


def _hold(fault: Acting) -> Codes:
    # a fault from the first sample on has no earlier value to hold: it keeps that first one
    held = fault.constant(fault.before)
    sigma = float(fault.params["noise"])
    if not sigma:
        return held
    # what the wires behind a stuck slider still pick up
    noise = fault.random("hold").standard_normal(len(held))
    return fault.transducer.saturate(held + sigma * noise)[0]


def _uncalibration(fault: Acting) -> Codes:
    return fault.transducer.saturate(fault.healthy * np.float64(fault.params["gain"]))[0]


def _offset(fault: Acting) -> Codes:
    return fault.plus(np.float64(fault.params["by"]) / fault.transducer.per_code)


def _drift(fault: Acting) -> Codes:
    rate = float(fault.params["rate"]) / fault.transducer.per_code
    return fault.plus(rate * fault.since_s)


def _noise(fault: Acting) -> Codes:
    sigma = float(fault.params["sigma"]) / fault.transducer.per_code
    return fault.plus(sigma * fault.random("noise").standard_normal(fault.stop - fault.start))


def _spike(fault: Acting) -> Codes:
    since_s = fault.since_s
    random = fault.random("spike")
    mean_s = 1.0 / float(fault.params["rate"])
    at = _renewals(lambda: random.exponential(mean_s, _BLOCK), since_s)
    up = np.where(fault.random("direction").random(len(at)) < 0.5, -1.0, 1.0)
    latest = np.searchsorted(at, since_s, side="right") - 1
    within = (latest >= 0) & (since_s - at[latest] < float(fault.params["width"]))
    height = float(fault.params["height"]) / fault.transducer.per_code
    return fault.plus(np.where(within, up[latest] * height, 0.0))


def _loose_contact(fault: Acting) -> Codes:
    since_s = fault.since_s
    row, duty = fault.transducer, float(fault.params["duty"])
    mean_s = np.array([1.0 - duty, duty]) / float(fault.params["frequency"])
    random = fault.random("loose_contact")
    # closed until the first, then open until the second ...
    turns = _renewals(lambda: np.ravel(random.exponential(1.0, (_BLOCK, 2)) * mean_s), since_s)
    opened = np.searchsorted(turns, since_s, side="right") % 2 == 1
    # an open input reads what its pull resistor pulls it to
    reads = row.code_min if fault.params["pull"] == "down" else row.code_max
    return np.where(opened, np.int32(reads), fault.healthy)


def _renewals(gaps: Callable[[], Floats], since_s: Floats) -> Floats:
    """Instants in seconds, float64, each a gap after the one before, until one is past `since_s`.

    gaps: the next block of them; always as many, so that a longer fault begins as a shorter one does.
    """
    last = float(since_s[-1]) if len(since_s) else 0.0
    blocks = [np.cumsum(gaps())]
    while blocks[-1][-1] <= last:
        blocks.append(blocks[-1][-1] + np.cumsum(gaps()))
    return np.concatenate(blocks)


def _delay(fault: Acting) -> Codes:
    then_ns = fault.t_ns[fault.start : fault.stop] - round(float(fault.params["by"]) * 1e9)
    latest = np.searchsorted(fault.t_ns, then_ns, side="right") - 1
    return fault.codes[np.maximum(latest, 0)]


def _slow(fault: Acting) -> Codes:
    from bench.sensors.lowpass import lowpass  # numba: only who needs it waits for it

    first = max(fault.start - 1, 0)
    lowpass_hz = 1.0 / (2.0 * math.pi * float(fault.params["tau"]))
    signal: Floats = fault.codes[first : fault.stop].astype(np.float64)
    late = lowpass(fault.t_ns[first : fault.stop], signal, lowpass_hz, 1, signal[0], 0.0)
    return fault.transducer.saturate(late[fault.start - first :])[0]


KINDS: dict[str, Kind] = {
    "open": SensorKind(
        act=_open,
        about="open circuit: the full scale",
        where="sensor",
        params={},
        called=always("open"),
        ftb=byte(0x13),
        thesis="open circuit (section V.2.1)",
    ),
    "short": SensorKind(
        act=_short,
        about="short circuit: to ground the minimum, to battery the full scale",
        where="sensor",
        params={"to": Choice(("gnd", "batt"))},
        # at the full scale nobody can tell a short to battery from an open circuit
        called=lambda params: "short" if params["to"] == "gnd" else "open",
        ftb=lambda params: 0x11 if params["to"] == "gnd" else 0x12,
        thesis="short circuit (section V.2.1)",
    ),
    "hold": SensorKind(
        act=_hold,
        about="the last value before the fault, under noise of so many codes (sigma)",
        where="sensor",
        params={"noise": Number(0.0, 0.0, 1000.0, extra=True, unit="codes"), "seed": SEED},
        called=always("hold"),
        ftb=byte(0x2A),
        thesis="hold (section V.2.2)",
    ),
    "uncalibration": SensorKind(
        act=_uncalibration,
        about="losing calibration: another slope of the input/output curve",
        where="sensor",
        params={"gain": Number(1.1, 0.0, 10.0)},
        called=always("uncalibration"),
        ftb=byte(0x62),
        thesis="losing calibration (section V.2.3)",
    ),
    "offset": SensorKind(
        act=_offset,
        about="losing calibration: an offset, in the unit of the sensor's channel",
        where="sensor",
        params={"by": Number(5.0, -1000.0, 1000.0, unit="unit")},
        called=always("uncalibration"),
        ftb=byte(0x28),
    ),
    "drift": SensorKind(
        act=_drift,
        about="an offset that grows from zero at so much a second",
        where="sensor",
        params={"rate": Number(1.0, -1000.0, 1000.0, unit="unit/s")},
        called=always("uncalibration"),
        ftb=byte(0x28),
    ),
    "noise": SensorKind(
        act=_noise,
        about="white Gaussian noise of this sigma on every sample",
        where="sensor",
        params={"sigma": Number(1.0, 0.0, 1000.0, unit="unit"), "seed": SEED},
        called=always(None),
        ftb=byte(0x2F),
    ),
    "spike": SensorKind(
        act=_spike,
        about="spikes of this height and width, up or down, at random instants (Poisson)",
        where="sensor",
        params={
            "rate": Number(2.0, 0.001, 1000.0, unit="1/s"),
            "height": Number(30.0, 0.0, 1000.0, unit="unit"),
            "width": Number(0.01, 0.0001, 1.0, unit="s"),
            "seed": SEED,
        },
        called=always(None),
        ftb=byte(0x27),
    ),
    "loose_contact": SensorKind(
        act=_loose_contact,
        about="a contact that opens at random, so often a second and for this share of the time; open, the "
        "input reads where it is pulled",
        where="sensor",
        params={
            "frequency": Number(5.0, 0.001, 1000.0, unit="Hz"),
            "duty": Number(0.3, 0.0, 1.0),
            "pull": PULL,
            "seed": SEED,
        },
        called=always(None),
        ftb=byte(0x1F),
    ),
    "delay": SensorKind(
        act=_delay,
        about="the signal comes so much later",
        where="sensor",
        params={"by": Number(0.1, 0.0, 60.0, unit="s")},
        called=always(None),
        ftb=byte(None),
    ),
    "slow": SensorKind(
        act=_slow,
        about="a lag of first order with this time constant",
        where="sensor",
        params={"tau": Number(0.5, 0.001, 60.0, unit="s")},
        called=always(None),
        ftb=byte(0x26),
    ),
}
"""The kinds that every sensor has; the thesis's four come first."""
