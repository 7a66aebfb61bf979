"""What a program writes to its USARTs and to ITM, and what it is sent: the face to Python."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from targets.mcu import itm, records, usart
from targets.mcu.state import USART, USART_STRIDE, HasState

ITM = "ITM"
NAMES = (*usart.NAMES, ITM)


class Log(NamedTuple):
    """Bytes with the instants at which they were out: int64 ns and uint8, both (n,); lost: older ones."""

    ns: NDArray[np.int64]
    data: NDArray[np.uint8]
    lost: int


def log(mcu: HasState, name: str) -> Log:
    """What was written to a USART, or to ITM's stimulus port 0, with instants. Raises ValueError for no such
    name.
    """
    unit = _unit(name, NAMES)
    S = mcu.state
    usart.service(S)
    kept = records.kept(S, records.LOG + unit)
    lost = records.lost(S, records.LOG + unit)
    if name != ITM:
        return Log(kept[:, 0], kept[:, 1].astype(np.uint8), lost)
    port_0 = kept[kept[:, 1] >> itm.PORT_SHIFT == 0]
    sizes = port_0[:, 1] >> itm.SIZE_SHIFT & 7
    values = port_0[:, 1].astype("<i8").view(np.uint8).reshape(-1, 8)[:, :4]
    return Log(np.repeat(port_0[:, 0], sizes), values[np.arange(4) < sizes[:, None]], lost)


def output(mcu: HasState, name: str) -> bytes:
    """The bytes alone."""
    return log(mcu, name).data.tobytes()


def feed(mcu: HasState, name: str, data: bytes) -> None:
    """Send bytes to a USART, back to back at its baud rate, from now on or after those under way.

    Raises ValueError for no such name, or if more bytes wait than there is room for.
    """
    unit = _unit(name, usart.NAMES)
    S = mcu.state
    usart.service(S)
    ring = records.INPUT + unit
    if records.room(S, ring) < len(data):
        raise ValueError(f"{len(data)} bytes for {name} while {records.waiting(S, ring)} wait")
    for byte in data:
        records.append(S, ring, (byte,))
    usart.begin_input(S, unit)


def unheard(mcu: HasState, name: str) -> int:
    """Bytes fed to a USART that was not listening, or had not been read in time."""
    unit = _unit(name, usart.NAMES)
    usart.settle(mcu.state, unit)
    return int(mcu.state[USART + USART_STRIDE * unit + usart.LOST])


def _unit(name: str, names: tuple[str, ...]) -> int:
    if name not in names:
        raise ValueError(f"there is no {name}, but " + ", ".join(names))
    return names.index(name)
