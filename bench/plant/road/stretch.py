"""A stretch: a piece of road of one kind, and how it is ridden.

Belongs here: what a stretch is and which values it may have. Never: its file format or its heights.
"""

from dataclasses import dataclass

from bench.errors import RouteError
from bench.plant.road.limits import check_number
from bench.plant.road.obstacles import Obstacle
from bench.plant.road.profiles import Profile
from bench.plant.road.surface import SURFACES


@dataclass(frozen=True)
class Stretch:
    """A piece of road: a surface, or None with a measured profile; its target speed; what lies on it.

    `lean_deg` is how far a motorcycle typically leans in its bends. Raises RouteError naming a value outside
    its limits.
    """

    surface: str | None
    length_m: float
    speed_kmh: float
    lean_deg: float = 0.0
    obstacles: tuple[Obstacle, ...] = ()
    profile: Profile | None = None

    def __post_init__(self) -> None:
        if self.profile is not None and self.surface is not None:
            raise RouteError(f"surface {self.surface!r} and profile {self.profile.name}: a stretch has one")
        if self.profile is None and (not isinstance(self.surface, str) or self.surface not in SURFACES):
            raise RouteError(f"unknown surface {self.surface!r}; the known ones are {', '.join(SURFACES)}")
        for name, limits in _LIMITS.items():
            check_number(name, getattr(self, name), *limits)
        for number, obstacle in enumerate(self.obstacles, 1):
            if obstacle.need_m > self.length_m:
                raise RouteError(
                    f"obstacle {number}: {obstacle.count} {obstacle.kind} may need {obstacle.need_m:g} m, "
                    f"the stretch is {self.length_m:g} m long"
                )


_LIMITS = {
    "length_m": (1.0, 100_000.0),
    "speed_kmh": (
        10.0,
        300.0,
    ),  # the wheel encoder's full scale; tyres may bear less
    "lean_deg": (0.0, 40.0),
}
