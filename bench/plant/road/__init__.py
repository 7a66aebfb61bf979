"""The road as an instrument: ISO 8608 surfaces, obstacles and measured profiles, laid one after the other."""

from bench.plant.road.build import LEAD_IN_M, build_road
from bench.plant.road.grid import STEP_M, Road

__all__ = ["LEAD_IN_M", "STEP_M", "Road", "build_road"]
