"""Errors of the bench's side. Each message is one line that names the value at fault."""


class BenchError(Exception):
    """Something on the bench's side of the bus is wrong; `side` opens the message shown to the user."""

    side = "bench"


class LapError(BenchError):
    """A lap file or a lap cannot be used."""

    side = "lap"


class RouteError(BenchError):
    """A route, road or motorcycle description is not physical or not complete."""

    side = "route"


class FaultError(BenchError):
    """A fault specification names something that does not exist or a value out of range."""

    side = "fault"


class SensorError(BenchError):
    """A sensor's description is not physical or not complete."""

    side = "sensor"


class BusError(BenchError):
    """A bus cannot be opened, or a frame cannot travel on it."""

    side = "bus"


class MavlinkError(BenchError):
    """No ground station can be reached, or it is asked for what the link cannot do."""

    side = "mavlink"


class RecordError(BenchError):
    """A recording or result file cannot be written."""

    side = "record"


class DebuggerError(BenchError):
    """No debugger can connect."""

    side = "gdb"
