"""Which lap a trial rides: one of the simulated motorcycle, or one in a file.

Belongs here: what identifies a lap, riding it. Never: a fault, how a file is read.
"""

from dataclasses import dataclass

from bench.errors import LapError
from bench.laps.lap import Lap
from bench.plant.motorcycle import Motorcycle, carrying, load_motorcycle
from bench.plant.ride import ride
from bench.plant.route import Route, load_route
from campaigns.store import Document


@dataclass(frozen=True)
class Simulated:
    """A lap of the simulated motorcycle. load_kg: luggage, over the rear axle."""

    route: str
    motorcycle: str
    seed: int
    seconds: float | None = None
    load_kg: float = 0.0

    def document(self) -> Document:
        """All that decides the lap; what was written before there was luggage knows none."""
        return {
            "route": self.route,
            "motorcycle": self.motorcycle,
            "seed": self.seed,
            "seconds": self.seconds,
            **({"load_kg": self.load_kg} if self.load_kg else {}),
        }

    def parts(self) -> tuple[Route, Motorcycle]:
        """What is ridden, and on what. Raises RouteError for what there is not."""
        return load_route(self.route), carrying(load_motorcycle(self.motorcycle), self.load_kg)

    def ridden(self) -> Lap:
        """The lap itself."""
        return ride(*self.parts(), self.seed, self.seconds)


@dataclass(frozen=True)
class Recorded:
    """A lap in a file; sha256 is the lap's own digest, whatever its format.

    Raises LapError for a name that a store cannot keep.
    """

    file: str
    sha256: str

    def __post_init__(self) -> None:
        try:
            self.file.encode()
        except UnicodeEncodeError:
            raise LapError(f"{self.file!a}: the file's name is no text, and cannot be kept") from None

    def document(self) -> Document:
        """All that decides the lap; the folder it lies in does not."""
        return {"file": self.file, "sha256": self.sha256}
