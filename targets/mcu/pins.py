"""The pins as the outside sees them: driven levels, and edges with their times."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from targets.jit import njit
from targets.mcu import gpio, records, tim
from targets.mcu.gpio import place
from targets.mcu.state import GPIO_PINS, GPIO_PINS_STRIDE, HasState, State


class Edges(NamedTuple):
    """A pin's output edges, oldest first, int64 (n,) each; lost: older edges of any pin.

    ns, cycles: when; optimistic, pessimistic: cycles by the timing model's bounds; level: after the edge.
    """

    ns: NDArray[np.int64]
    cycles: NDArray[np.int64]
    optimistic: NDArray[np.int64]
    pessimistic: NDArray[np.int64]
    level: NDArray[np.int64]
    lost: int


@njit(cache=True)
def _level(S: State, port: int) -> int:
    return S[GPIO_PINS + GPIO_PINS_STRIDE * port + gpio.LEVEL]


@njit(cache=True)
def drive(S: State, port: int, mask: int, levels: int) -> None:
    """From outside, pins of `mask` (bits 0 to 15) are held at `levels`; the port's others are let go."""
    before = _level(S, port)
    gpio.drive(S, port, mask, levels)
    after = _level(S, port)
    tim.edge(S, port, after & ~before, before & ~after)


def drive_pin(mcu: HasState, pin: str, level: int | None) -> None:
    """Hold one pin, "PB3", at 0 or 1, or let go of it (None); the others stay as they are."""
    S, port, bit = mcu.state, place(pin) // 16, 1 << place(pin) % 16
    at = GPIO_PINS + GPIO_PINS_STRIDE * port
    mask, levels = int(S[at + gpio.DRIVEN]) & ~bit, int(S[at + gpio.DRIVEN_HIGH]) & ~bit
    drive(S, port, mask | (bit if level is not None else 0), levels | (bit if level else 0))


def level(mcu: HasState, pin: str) -> int:
    """The level of a pin now."""
    tim.service(mcu.state)
    return int(_level(mcu.state, place(pin) // 16)) >> place(pin) % 16 & 1


def edges(mcu: HasState, pin: str) -> Edges:
    """The edges of a pin while it was an output. Raises ValueError if there is no such pin."""
    at = place(pin)
    S = mcu.state
    tim.service(S)
    kept = records.kept(S, records.EDGES)
    mine = kept[kept[:, 4] >> 1 == at]
    # A timer's edges are recorded when it is looked at, later than those of the program.
    ns, cycles, optimistic, pessimistic, what = mine[np.argsort(mine[:, 1], kind="stable")].T
    return Edges(ns, cycles, optimistic, pessimistic, what & 1, records.lost(S, records.EDGES))
