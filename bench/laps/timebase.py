"""From a recording to a lap: the time base judged, reported, and mended where that is asked for.

A common time base is the lap's; one that counts from some year is set to 0. Unless repaired it is kept to the
nanosecond: gaps, jitter and clock jumps forward are reported, time that repeats or goes back is refused.
Repaired: repeated samples dropped, jumps closed, gaps of up to 100 ms filled, longer ones left, jitter
resampled away; each mend is reported.

Separate tracks, each with its own times, are judged and mended one by one and then brought onto one uniform
grid, from the latest first sample to the earliest last one, that starts at 0. Between neighbouring samples
values run straight. Across a gap the last one holds, as it did for whoever listened to that bus; a straight
line would know the future and hide that nothing was heard. Repaired, gaps of up to 100 ms run straight too.
FIDELITY: a clock that jumps under several tracks shifts each by its own estimate, good to a track's jitter.

Belongs here: which clock a lap has. What gaps, jitter, jumps and repeats are stands in `bench.laps.steps`,
how they are mended in `bench.laps.mend`. Never: a format.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from bench.errors import LapError
from bench.laps.lap import Lap
from bench.laps.mend import FILL_NS, even_out, fill_gaps, grid_ns, mend_clock, round_period_ns, straight
from bench.laps.recording import Recording, Track
from bench.laps.steps import EPOCH_NS, GAP, Samples, check_span, in_ms, in_s, judge, refuse

_CUT_NS = 1_000_000_000
"""A lap that is shorter than its recording by more than this, for want of a track, is told so."""

Made = tuple[NDArray[np.int64], Mapping[str, NDArray[np.float64]], list[str]]


def lap_of(recording: Recording, repair: bool = False) -> Lap:
    """The lap of a recording; its damage is the reader's, then what was found or mended here.

    repair: mend instead of refusing. Raises LapError, one line naming the file, for time that repeats or goes
    back (the sample and both times) or starts below zero, for tracks that are single samples or have no time
    in common, and for a time base that would have to be made of more than 7,200,000 samples.
    """
    make = _common if recording.common else _merged
    try:
        t_ns, values, lines = make(recording, repair)
        return Lap(t_ns, values, recording.source, (*recording.damage, *lines))
    except LapError as error:
        # The lap names itself by its source; the file's whole path says more.
        text = str(error).removeprefix(f"{recording.where}: ").removeprefix(f"{recording.source}: ")
        raise LapError(f"{recording.where}: {text}") from None


def _common(recording: Recording, repair: bool) -> Made:
    t_ns = next(iter(recording.tracks.values())).t_ns
    values = {name: track.values for name, track in recording.tracks.items()}
    if len(t_ns) < 2:
        return t_ns, values, []
    if t_ns[0] >= EPOCH_NS:  # seconds in float64 would lose nanoseconds
        t_ns = t_ns - t_ns[0]
    samples = Samples(t_ns, values, np.arange(len(t_ns)))
    if not repair:
        if t_ns[0] < 0:
            raise LapError(f"negative time: it starts at {in_s(t_ns[0])}; --repair shifts it to 0")
        refuse(samples, recording.where)
        return t_ns, values, judge(samples)
    lines = []
    for mend in (mend_clock, fill_gaps, even_out):
        samples, more = mend(samples, recording.where)
        lines += more
    start = min(int(samples.t_ns[0]), 0)
    if start < 0:
        lines.append(f"time starts at {in_s(start)}; shifted to 0")
    return samples.t_ns - start, samples.values, lines


def _merged(recording: Recording, repair: bool) -> Made:
    tracks, lines = {}, []
    for name, track in recording.tracks.items():
        tracks[name], more = _judged(name, track, recording.where, repair)
        lines += more
    start, end, more = _overlap(tracks)
    if recording.rate_hz is None:
        period = round_period_ns(min(track.nominal_ns for track in tracks.values()))
    else:
        period = round(1e9 / recording.rate_hz)
    t_ns = grid_ns(start, end, period, recording.where)
    if len(t_ns) < 2:
        raise LapError(
            f"the channels have {in_ms(end - start)} in common, less than a step of {in_ms(period)}"
        )
    bridged_ns = FILL_NS if repair else 0
    values = {name: _on_grid(t_ns, track, name, bridged_ns) for name, track in tracks.items()}
    return t_ns - start, values, lines + more


def _judged(name: str, track: Track, where: str, repair: bool) -> tuple[Samples, list[str]]:
    samples = Samples(track.t_ns, {name: track.values}, np.arange(len(track.t_ns)), f"{name}: ")
    lines: list[str] = []
    if len(samples.t_ns):
        check_span(samples, where)
        if repair:
            samples, lines = mend_clock(samples, where)
    if len(samples.t_ns) < 2:
        raise LapError(f"{name}: {len(samples.t_ns)} samples: a time base needs at least 2")
    refuse(samples, where)
    return samples, lines + judge(samples)


def _overlap(tracks: Mapping[str, Samples]) -> tuple[int, int, list[str]]:
    """Where all tracks have begun and none has ended, with lines about what is cut off before and after."""
    late = max(tracks, key=lambda name: tracks[name].t_ns[0])
    early = min(tracks, key=lambda name: tracks[name].t_ns[-1])
    start, end = int(tracks[late].t_ns[0]), int(tracks[early].t_ns[-1])
    if end <= start:
        raise LapError(f"no time in common: {early} ends {in_s(start - end)} before {late} begins")
    before = start - min(int(track.t_ns[0]) for track in tracks.values())
    after = max(int(track.t_ns[-1]) for track in tracks.values()) - end
    lines = []
    if before > _CUT_NS:
        lines.append(f"{late}: begins {in_s(before)} after the first channel; the lap begins with it")
    if after > _CUT_NS:
        lines.append(f"{early}: ends {in_s(after)} before the last channel; the lap ends with it")
    return start, end, lines


def _on_grid(t_ns: NDArray[np.int64], track: Samples, name: str, bridged_ns: int) -> NDArray[np.float64]:
    values = straight(t_ns, track.t_ns, track.values[name])
    wide = track.steps > max(GAP * track.nominal_ns, bridged_ns)
    if wide.any():
        before = np.searchsorted(track.t_ns, t_ns, side="right") - 1
        held = np.append(wide, False)[before]
        values[held] = track.values[name][before[held]]
    return values
