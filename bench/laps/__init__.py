"""Test laps: the immutable `Lap` and the files it comes from."""

from bench.laps.files import read_lap, write_lap
from bench.laps.lap import CHANNELS, Lap

__all__ = ["CHANNELS", "Lap", "read_lap", "write_lap"]
