"""From a recording to a lap: the time base judged, reported, and mended where that is asked for.

Belongs here: what a gap, jitter, a clock jump and a repeated sample are, and how each is mended. Never: a format.
"""

from bench.errors import LapError
from bench.laps.lap import Lap
from bench.laps.recording import Recording


def lap_of(recording: Recording, repair: bool = False) -> Lap:
    """The lap of a recording whose tracks share their time base."""
    t_ns = next(iter(recording.tracks.values())).t_ns
    try:
        return Lap(
            t_ns,
            {name: track.values for name, track in recording.tracks.items()},
            recording.source,
            recording.damage,
        )
    except LapError as error:
        # The lap names itself by its source; the file's whole path says more.
        raise LapError(f"{recording.where}: {str(error).removeprefix(f'{recording.source}: ')}") from None
