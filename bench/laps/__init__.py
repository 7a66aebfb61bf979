"""Test laps: the immutable `Lap` and the files it comes from."""

from bench.laps.lap import CHANNELS, Lap

__all__ = ["CHANNELS", "Lap"]
