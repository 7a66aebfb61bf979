"""The lap: one time base, named channels, each with a unit in its name. Immutable.

Belongs here: what a lap is, and the checks every lap passes whatever file it came from. Never: a file format.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from hashlib import sha256

import numpy as np
from numpy.typing import NDArray

from bench.errors import LapError
from dbc import CHANNELS


@dataclass(frozen=True, eq=False)
class Lap:
    """A recorded or simulated ride. Laps are equal if time base and channels are, whatever their source.

    t_ns: int64 (samples,), from zero or later, strictly increasing, nanoseconds.
    channels: channel name -> float64 (samples,), read-only; names are a subset of CHANNELS.
    damage: what was found wrong with the recording, or mended, one line each; no part of equality.
    Raises LapError for NaN, unknown channels, unequal lengths, negative time, or time that does not increase.
    """

    t_ns: NDArray[np.int64]
    channels: Mapping[str, NDArray[np.float64]]
    source: str = ""
    damage: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        t_ns = np.array(self.t_ns, dtype=np.int64)
        if t_ns.ndim != 1 or len(t_ns) < 2:
            raise LapError(f"{self._where()}{t_ns.size} samples: a lap needs at least 2")
        if t_ns[0] < 0:
            raise LapError(f"{self._where()}negative time: it starts at {t_ns[0] / 1e9:.9g} s")
        back = np.flatnonzero(np.diff(t_ns) <= 0)
        if back.size:
            k = int(back[0]) + 1
            raise LapError(
                f"{self._where()}time does not increase at sample {k}: "
                f"{t_ns[k - 1] / 1e9:.9g} s then {t_ns[k] / 1e9:.9g} s"
            )
        t_ns.setflags(write=False)
        channels = {}
        for name in sorted(self.channels, key=_order):
            values = np.array(self.channels[name], dtype=np.float64)
            if values.shape != t_ns.shape:
                raise LapError(
                    f"{self._where()}channel {name} has {values.size} samples, the time base {t_ns.size}"
                )
            bad = np.flatnonzero(~np.isfinite(values))
            if bad.size:
                k = int(bad[0])
                raise LapError(
                    f"{self._where()}channel {name} is {values[k]} at sample {k} ({t_ns[k] / 1e9:.9g} s)"
                )
            values.setflags(write=False)
            channels[name] = values
        if not channels:
            raise LapError(f"{self._where()}no channel; the known ones are {', '.join(CHANNELS)}")
        object.__setattr__(self, "t_ns", t_ns)
        object.__setattr__(self, "channels", channels)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Lap) and self.digest() == other.digest()

    def __hash__(self) -> int:
        return hash(self.digest())

    def _where(self) -> str:
        return f"{self.source}: " if self.source else ""

    @property
    def duration_ns(self) -> int:
        """From the first sample to the last, nanoseconds."""
        return int(self.t_ns[-1] - self.t_ns[0])

    def require(self, names: Iterable[str], who: str) -> None:
        """Raise LapError naming the channels of `names` that this lap lacks and `who` needs them."""
        missing = [name for name in names if name not in self.channels]
        if missing:
            raise LapError(f"{self._where()}missing {', '.join(missing)}, needed by {who}")

    def digest(self) -> str:
        """SHA-256 over time base, channel names and values: two laps are the same lap if it is equal."""
        digest = sha256(self.t_ns.tobytes())
        for name, values in self.channels.items():
            digest.update(name.encode() + b"\0" + values.tobytes())
        return digest.hexdigest()


def _order(name: str) -> int:
    try:
        return CHANNELS.index(name)
    except ValueError:
        raise LapError(f"unknown channel {name}; the known ones are {', '.join(CHANNELS)}") from None
