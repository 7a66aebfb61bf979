"""Test laps: the immutable `Lap` and the files it comes from."""

from bench.laps.files import read_lap, write_lap
from bench.laps.lap import Lap
from dbc import CHANNELS

__all__ = ["CHANNELS", "Lap", "read_lap", "write_lap"]
