"""CAN logs as laps: one module a format, all of them turned into `frames.Frames` and decoded by `log`."""
