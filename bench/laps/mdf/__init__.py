"""ASAM MDF4 as laps: measurements by channel, and bus logging by frames."""
