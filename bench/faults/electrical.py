"""Faults of the wiring of a stroke potentiometer, by its circuit: shorts, resistances, leaks, ground shift.

Belongs here: which resistor a kind changes. Never: how the circuit is solved (`bench.sensors.network`), a
fault of another sensor.

A healthy code is the voltage at the pin of the healthy circuit, so it says where the slider stands; the
faulty circuit with the slider there gives the faulty code. A fault that changes no resistor changes no code.
FIDELITY: what the pull resistor bends of a healthy characteristic is part of the codes already. Two such
faults of one sensor at a time compose as if the first were the slider's, not as one circuit.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bench.faults.kind import Acting, Choice, Codes, Kind, Number, Params, SensorKind, always, byte
from bench.sensors.network import BATTERY, Network, joined
from bench.sensors.transducers import REFERENCE_V, TRANSDUCERS, Transducer

PULL = Choice(("up", "down"), extra=True)
"""Where the resistor at the converter's pin pulls: to the supply, or to ground."""

_NEIGHBOUR = {"fork_stroke": "rear_stroke", "rear_stroke": "fork_stroke"}
_POTENTIALS = {"gnd": 0.0, "batt": BATTERY, "supply": 1.0}
_OHM = 1e9  # more is an open circuit
_WIRE_OHM = 0.01  # so that two sliders at the ends of their tracks are no two ideal sources on one node


def healthy_network(params: Params) -> Network:
    """The circuit without a fault, with the pull resistor that a fault's parameters name."""
    return Network(pull_to=0.0 if params.get("pull") == "down" else 1.0)


def _voltage(transducer: Transducer, codes: Codes) -> NDArray[np.float64]:
    return (codes - transducer.code_min) / np.float64(transducer.code_max - transducer.code_min)


def _through(fault: Acting, v: NDArray[np.float64]) -> Codes:
    row = fault.transducer
    return row.saturate(v * (row.code_max - row.code_min) + row.code_min)[0]


def _solve(fault: Acting, faulty: Network) -> Codes:
    x = healthy_network(fault.params).slider(_voltage(fault.transducer, fault.healthy))
    return _through(fault, faulty.pin(x))


def _short_to(potential: str) -> SensorKind:
    ground = potential == "gnd"

    def act(fault: Acting) -> Codes:
        leak = replace(healthy_network(fault.params), leak_ohm=0.0, leak_to=_POTENTIALS[potential])
        return _solve(fault, leak)

    return SensorKind(
        act=act,
        about=f"the signal's wire touches {'ground' if ground else 'the battery (12 V)'}: "
        f"{'zero' if ground else 'full scale'}",
        where="potentiometer",
        params={},
        # at the full scale nobody can tell a short to battery from an open circuit
        called=always("short" if ground else "open"),
        ftb=byte(0x11 if ground else 0x12),
        thesis="short circuit" if ground else None,
    )


def _short_pin(fault: Acting) -> Codes:
    network = healthy_network(fault.params)
    other = TRANSDUCERS[_NEIGHBOUR[fault.transducer.sensor]]
    if fault.params["to"] == "supply":
        return _solve(fault, replace(network, leak_ohm=0.0, leak_to=1.0))
    wired = replace(network, signal_ohm=_WIRE_OHM)
    here, there = (
        wired.source(network.slider(_voltage(row, codes)))
        for row, codes in (
            (fault.transducer, fault.healthy),
            (other, fault.others[other.sensor][fault.start : fault.stop]),
        )
    )
    return _through(fault, joined(*here, *there)[0])


def _bridged(sensor: str, params: Params) -> tuple[str, ...]:
    return (_NEIGHBOUR[sensor],) if params["to"] == "signal" else ()


def _series(fault: Acting) -> Codes:
    ohm = float(fault.params["ohm"])
    return _solve(fault, replace(healthy_network(fault.params), **{f"{fault.params['wire']}_ohm": ohm}))


def _leakage(fault: Acting) -> Codes:
    to = _POTENTIALS[str(fault.params["to"])]
    ohm = float(fault.params["ohm"])
    return _solve(fault, replace(healthy_network(fault.params), leak_ohm=ohm, leak_to=to))


def _ground_shift(fault: Acting) -> Codes:
    shift = float(fault.params["by"]) / REFERENCE_V
    return _solve(fault, replace(healthy_network(fault.params), ground=shift))


KINDS: dict[str, Kind] = {
    "short_gnd": _short_to("gnd"),
    "short_batt": _short_to("batt"),
    "short_pin": SensorKind(
        act=_short_pin,
        also=_bridged,
        about="a bridge to the next pin: the other stroke's signal (both then read the same share of their "
        "ranges), or the supply",
        where="potentiometer",
        params={"to": Choice(("signal", "supply"))},
        called=lambda params: "open" if params["to"] == "supply" else None,
        ftb=lambda params: 0x12 if params["to"] == "supply" else 0x2B,
    ),
    "series_resistance": SensorKind(
        act=_series,
        about="a corroded contact: so many ohms in the wire of supply, ground or signal",
        where="potentiometer",
        params={
            "ohm": Number(500.0, 0.0, _OHM, unit="ohm"),
            "wire": Choice(("supply", "ground", "signal")),
            "pull": PULL,
        },
        called=always("uncalibration"),
        ftb=byte(0x1B),
    ),
    "leakage": SensorKind(
        act=_leakage,
        about="moisture: so many ohms from the signal to ground, battery or supply",
        where="potentiometer",
        params={
            "ohm": Number(10_000.0, 0.0, _OHM, unit="ohm"),
            "to": Choice(("gnd", "batt", "supply")),
            "pull": PULL,
        },
        called=always("uncalibration"),
        ftb=byte(0x1A),
    ),
    "ground_shift": SensorKind(
        act=_ground_shift,
        about="the sensor's ground lies so many volts above the converter's",
        where="potentiometer",
        params={"by": Number(0.25, -5.0, 5.0, unit="V"), "pull": PULL},
        called=always("uncalibration"),
        ftb=byte(0x28),
    ),
}
"""The kinds that only a ratiometric potentiometer has."""
