"""What a fault kind is: its parameters, where it may act, and what others call it.

Belongs here: the shape of a row of the catalogue. Never: a row.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from bench.sensors.transducers import Transducer

if TYPE_CHECKING:
    from bench.faults.striking import Striking, Struck

Value = float | str
Params = Mapping[str, Value]
Codes = NDArray[np.int32]


@dataclass(frozen=True)
class Number:
    """A numeric parameter: its default and the closed interval it must lie in.

    extra: written only where it is not the default, for what most faults of the kind do without.
    whole: an integer. unit: of the value, "unit" for that of the sensor's channel.
    """

    default: float
    low: float
    high: float
    extra: bool = False
    whole: bool = False
    unit: str = ""


@dataclass(frozen=True)
class Choice:
    """A parameter that is one of a few words; the first is the default. extra: as of a Number."""

    options: tuple[str, ...]
    extra: bool = False

    @property
    def default(self) -> str:
        """The word taken when none is given."""
        return self.options[0]


SEED = Number(0.0, 0.0, 2.0**32 - 1.0, extra=True, whole=True)
"""The parameter `seed` of every kind that draws."""


def stream(params: Params, *also: int | str) -> np.random.Generator:
    """The random numbers of a fault: of its seed, and of what else is known when it begins."""
    key = [crc32(part.encode()) if isinstance(part, str) else part & 0xFFFF_FFFF_FFFF_FFFF for part in also]
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence([int(params["seed"]), *key])))


class Acting(NamedTuple):
    """A fault at work: it acts on samples [start, stop) of `codes` int32 (samples,), at `t_ns` int64.

    t_cmd_ns: when it was asked for. others: the codes of every sensor of the lap, before this fault.
    """

    codes: Codes
    t_ns: NDArray[np.int64]
    start: int
    stop: int
    transducer: Transducer
    params: Params
    t_cmd_ns: int
    others: Mapping[str, Codes]

    @property
    def healthy(self) -> Codes:
        """The codes of the fault's samples as they were, int32 (stop - start,)."""
        return self.codes[self.start : self.stop]

    @property
    def since_s(self) -> NDArray[np.float64]:
        """Time of the fault's samples since it was asked for, float64 seconds (stop - start,)."""
        return np.asarray((self.t_ns[self.start : self.stop] - self.t_cmd_ns) * 1e-9, np.float64)

    @property
    def before(self) -> int:
        """The last code before the fault; the first of all for one that acts from there on."""
        return int(self.codes[max(self.start - 1, 0)])

    def constant(self, code: int) -> Codes:
        """`code` for as long as the fault lasts, int32 (stop - start,)."""
        return np.full(self.stop - self.start, code, dtype=np.int32)

    def plus(self, codes: NDArray[np.float64] | float) -> Codes:
        """The healthy codes and so many more, rounded and saturated."""
        return self.transducer.saturate(np.asarray(self.healthy + codes, np.float64))[0]

    def random(self, purpose: str) -> np.random.Generator:
        """Random numbers for `purpose`: nothing that comes after the command decides them."""
        return stream(self.params, self.t_cmd_ns, f"{self.transducer.sensor}:{purpose}", self.before)


@dataclass(frozen=True, kw_only=True)
class Kind:
    """One row of the catalogue.

    where: the class of places it acts on, a key of `places.WHERE`. about: what it does, in a line.
    called: the name in IFD_STATUS.kind that is right for the fault with these parameters, None if there is
    none: an alarm may then name any. ftb: its failure type byte, None if none fits. thesis: the name there.
    """

    about: str
    where: str
    params: Mapping[str, Number | Choice]
    called: Callable[[Params], str | None]
    ftb: Callable[[Params], int | None]
    thesis: str | None = None


@dataclass(frozen=True, kw_only=True)
class SensorKind(Kind):
    """A kind that acts on the codes of a sensor.

    act: the faulty codes of the fault's samples; each of them depends on nothing later than itself.
    also: the other sensors on which the fault of this sensor acts too, by the same `act`.
    """

    act: Callable[[Acting], Codes]
    also: Callable[[str, Params], tuple[str, ...]] = lambda _sensor, _params: ()


@dataclass(frozen=True, kw_only=True)
class BusKind(Kind):
    """A kind that acts on the frames which the logger hands to the bus.

    strike: what becomes of them. lasts_ns: how much longer than asked for it acts.
    """

    strike: "Callable[[Striking], Struck]"
    lasts_ns: Callable[[Params], int] = lambda _: 0


def always(what: str | None) -> Callable[[Params], str | None]:
    """The same name whatever the parameters."""
    return lambda _: what


def byte(ftb: int | None) -> Callable[[Params], int | None]:
    """The same failure type byte whatever the parameters."""
    return lambda _: ftb
