"""From recordings to laps: what is refused, what is reported, what `repair` mends."""

import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.errors import LapError
from bench.laps.recording import Recording, Track
from bench.laps.steps import Samples, judge
from bench.laps.timebase import lap_of

MS = 1_000_000
S = 1_000 * MS


def common(t_ms, values=None, damage=()):
    """A recording of one clock; the fork's stroke is ten times the time unless given."""
    t_ms = np.asarray(t_ms, dtype=float)
    fork = 10 * t_ms if values is None else np.asarray(values, dtype=float)
    t_ns = np.rint(t_ms * MS).astype(np.int64)
    return Recording("/laps/a.csv", "a.csv", {"fork_stroke_mm": Track(t_ns, fork)}, damage=damage)


def separate(rate_hz=None, **times_ms):
    """A recording of several clocks; a channel's value is ten times its time."""
    tracks = {}
    for name, times in times_ms.items():
        t_ms = np.asarray(times, dtype=float)
        tracks[name] = Track(np.rint(t_ms * MS).astype(np.int64), 10 * t_ms)
    return Recording("/laps/a.log", "a.log", tracks, common=False, rate_hz=rate_hz)


def without(t_ms, first, last):
    t_ms = np.asarray(t_ms)
    return t_ms[(t_ms < first) | (t_ms > last)]


def test_a_regular_time_base_is_kept_and_nothing_said():
    """Even steps are the lap's, to the nanosecond, with or without repair."""
    for repair in (False, True):
        lap = lap_of(common(np.arange(7, 1000)), repair)
        assert lap.t_ns.tolist() == (np.arange(7, 1000) * MS).tolist()
        assert lap.damage == ()


def test_the_readers_damage_comes_first():
    """What the reader had to skip stands in the lap's damage before what the clock shows."""
    lap = lap_of(common(without(range(100), 50, 59), damage=("skipped 3 bytes",)))
    assert [line.split()[0] for line in lap.damage] == ["skipped", "gap"]


@pytest.mark.parametrize(
    ("t_ms", "values", "says"),
    [
        (
            [0, 1, 1, 2, 2],
            [5, 6, 6, 7, 7],
            r"sample 2: 0\.001 s then 0\.001 s \(the same sample again, 2 such in all\)",
        ),
        ([0, 1, 1, 2], [5, 6, 7, 8], r"sample 2: 0\.001 s then 0\.001 s \(other values at the same time\)"),
        ([5, 6, 7, 2, 3], None, r"sample 3: 0\.007 s then 0\.002 s \(set back\)"),
    ],
)
def test_time_that_does_not_increase_is_refused(t_ms, values, says):
    """A repeat or a step back is one line with file, sample, both times and the way out."""
    with pytest.raises(LapError, match=r"^/laps/a\.csv: time does not increase at " + says) as refusal:
        lap_of(common(t_ms, values))
    assert str(refusal.value).endswith("--repair mends it")


def test_negative_time_is_refused():
    """A clock that starts below zero is refused, naming where it starts."""
    with pytest.raises(LapError, match=r"negative time: it starts at -0\.5 s; --repair"):
        lap_of(common([-500, -499]))


def test_negative_time_is_shifted_in_repair():
    """Repaired, a clock that starts below zero starts at zero."""
    lap = lap_of(common([-500, -499, -498]), repair=True)
    assert lap.t_ns.tolist() == [0, MS, 2 * MS]
    assert lap.damage == ("time starts at -0.5 s; shifted to 0",)


def test_a_clock_of_some_era_starts_at_zero():
    """Times since 1970 count from the first sample; a clock since start-up is left alone."""
    assert lap_of(common([2.0**41, 2.0**41 + 1024])).t_ns.tolist() == [0, 1024 * MS]
    assert lap_of(common([3.6e6, 3.6e6 + 1])).t_ns[0] == 3600 * S


def test_gaps_are_reported_with_the_largest_and_where():
    """The line on gaps has the widest, its place, how many there are and how much is missing."""
    t_ms = without(without(range(1000, 2000), 1100, 1109), 1500, 1698)
    lap = lap_of(common(t_ms))
    assert lap.damage == ("gap of 200 ms after 0.499 s, sample 489 (2 gaps, 0.209 s missing in all)",)
    assert len(lap.t_ns) == len(t_ms)


def test_a_step_within_half_a_step_is_no_gap():
    """A step of 1.5 nominal ones is jitter, one longer is a gap."""
    base = np.arange(100.0)
    late, later = base + 0.5 * (base >= 50), base + 0.51 * (base >= 50)
    assert [line.split()[0] for line in lap_of(common(late)).damage] == ["jitter:"]
    assert [line.split()[0] for line in lap_of(common(later)).damage] == ["gap"]


def test_jitter_is_reported_beyond_one_percent():
    """Steps within 1 % of the median pass without a word; beyond it, maximum and 99 % are told."""
    t_ms = np.arange(1000.0)
    t_ms[500] += 0.0099
    assert lap_of(common(t_ms)).damage == ()
    t_ms[500] += 0.1
    assert lap_of(common(t_ms)).damage == (
        "jitter: steps differ from 1 ms by up to 0.1099 ms (99 % by at most 0 ms), most after 0.499 s, "
        "sample 499",
    )


@pytest.mark.parametrize(("step_s", "word"), [(10.0, "gap"), (10.001, "clock")])
def test_a_long_step_is_a_clock_that_was_set(step_s, word):
    """A step beyond 10 s is a clock set forward, not samples lost; unrepaired it stays, reported."""
    t_ms = np.concatenate((np.arange(100), 99 + step_s * 1000 + np.arange(100)))
    lap = lap_of(common(t_ms))
    assert lap.damage[0].startswith(word)
    assert lap.duration_ns == round((t_ms[-1] - t_ms[0]) * MS)


def test_a_slow_recording_has_no_jumps():
    """At a sample a minute a step of two minutes is a gap: jumps are also beyond 100 nominal steps."""
    assert lap_of(common(without(np.arange(20) * 60_000, 300_000, 300_000))).damage[0].startswith("gap of")


def test_repeats_are_dropped_in_repair():
    """Of several samples at one time the first is kept; both kinds are counted, with their first place."""
    lap = lap_of(common([0, 1, 1, 2, 3, 3, 3, 4], [0, 1, 1, 2, 3, 8, 9, 4]), repair=True)
    assert lap.channels["fork_stroke_mm"].tolist() == [0, 1, 2, 3, 4]
    assert lap.damage == (
        "dropped 1 sample, the same again, first at 0.001 s, sample 2",
        "dropped 2 samples, other values at a time already taken, first at 0.003 s, sample 5",
    )


def test_jumps_are_closed_in_repair():
    """After a jump either way the time goes on at the nominal step, and the rest shifts with it."""
    t_ms = np.concatenate((np.arange(100), np.arange(40, 100), np.arange(3_600_100, 3_600_150)))
    lap = lap_of(common(t_ms), repair=True)
    assert lap.t_ns.tolist() == (np.arange(210) * MS).tolist()
    assert lap.channels["fork_stroke_mm"].tolist() == (10.0 * t_ms).tolist()
    assert lap.damage == (
        "clock set back by 0.06 s after 0.099 s, sample 99 (1 jump); the rest shifted, to go on at the "
        "nominal step",
        "clock set forward by 3600 s after 0.099 s, sample 159 (1 jump); the rest shifted, to go on at the "
        "nominal step",
    )


def test_a_single_wild_time_is_mended():
    """One time stamp far off, there and back, costs nothing."""
    t_ms = np.arange(200.0)
    t_ms[77] = 5e9
    lap = lap_of(common(t_ms, np.arange(200)), repair=True)
    assert lap.t_ns.tolist() == (np.arange(200) * MS).tolist()
    assert len(lap.damage) == 2


def test_short_gaps_are_filled_in_repair():
    """Up to 100 ms are filled on straight lines; samples that were there stay as they were."""
    lap = lap_of(common(without(range(1000), 300, 398)), repair=True)
    assert lap.t_ns.tolist() == (np.arange(1000) * MS).tolist()
    np.testing.assert_allclose(lap.channels["fork_stroke_mm"], 10.0 * np.arange(1000), rtol=1e-12)
    assert lap.damage == (
        "gap of 100 ms after 0.299 s, sample 299 (1 gap, 0.099 s missing in all); filled with 99 samples",
    )


def test_long_gaps_are_left_in_repair():
    """Beyond 100 ms nothing is invented: the gap stays and is said to."""
    lap = lap_of(common(without(range(1000), 300, 399)), repair=True)
    assert len(lap.t_ns) == 900
    assert lap.damage == (
        "gap of 101 ms after 0.299 s, sample 299 (1 gap, 0.1 s missing in all); left as it is",
    )


def test_jitter_is_resampled_in_repair():
    """Jittered samples of a straight line come back on an even grid, on the line, long gaps still gaps."""
    rng = np.random.default_rng(3)
    t_ms = np.arange(3000) + rng.uniform(-0.3, 0.3, 3000)
    t_ms = without(t_ms, 1000, 1499.8)
    lap = lap_of(common(t_ms - t_ms[0]), repair=True)
    steps = np.diff(lap.t_ns)
    assert np.count_nonzero(steps != MS) == 1
    assert steps.max() > 490 * MS
    np.testing.assert_allclose(lap.channels["fork_stroke_mm"], 10 * lap.t_ns / MS, atol=1e-6)
    assert lap.damage[-1].endswith("; resampled every 1 ms")


def test_a_coarse_clock_keeps_its_rate_in_repair():
    """300 Hz written in whole milliseconds (3, 3, 4) comes back at 300 Hz, not at the median's 333."""
    t_ms = np.floor(np.arange(3000) / 0.3)
    assert set(np.diff(lap_of(common(t_ms), repair=True).t_ns)) == {3_333_333}


def test_a_repaired_lap_needs_no_repair():
    """What repair hands out, but for the long gaps it leaves, shows nothing any more."""
    rng = np.random.default_rng(9)
    t_ms = np.arange(2000) + rng.uniform(-0.2, 0.2, 2000)
    t_ms[1500:] -= 700
    t_ms = np.repeat(t_ms - t_ms[0], rng.choice([1, 2], 2000, p=[0.9, 0.1]))
    t_ms = np.delete(t_ms, np.arange(600, 640))
    once = lap_of(common(t_ms), repair=True)
    assert len(once.damage) == 4
    samples = Samples(once.t_ns, once.channels, np.arange(len(once.t_ns)))
    assert judge(samples) == []


@given(st.lists(st.integers(-(2**40), 2**40), min_size=1, max_size=40), st.booleans())
def test_any_clock_becomes_a_lap_or_a_refusal(times, is_common):
    """Whatever the times are, the outcome is a lap or one LapError that names the file."""
    t_ns = np.array(times)
    tracks = {name: Track(t_ns, np.zeros(len(t_ns))) for name in ("fork_stroke_mm", "speed_kmh")}
    says = ""
    for repair in (False, True):
        try:
            lap_of(Recording("/laps/a.csv", "a.csv", tracks, is_common), repair)
        except LapError as error:
            says = str(error)
        assert says.startswith("/laps/a.csv: ") or not says
        assert "\n" not in says


@pytest.mark.parametrize("repair", [False, True])
@pytest.mark.parametrize("is_common", [False, True])
def test_times_beyond_any_clock_are_refused(repair, is_common):
    """Times further apart than int64 nanoseconds can subtract are refused, not wrapped around."""
    t_ns = np.array([-9 * 10**18, 0, 9 * 10**18])
    tracks = {"fork_stroke_mm": Track(t_ns, np.zeros(3))}
    with pytest.raises(LapError, match=r"negative time|is no lap's"):
        lap_of(Recording("a", "a", tracks, is_common), repair)


def test_filling_is_bounded():
    """A recording whose gaps would take more samples than a lap may have is refused, not allocated."""
    t_ns = np.concatenate((np.arange(200), np.arange(1, 100) * 90 * MS))
    recording = Recording("a.csv", "a.csv", {"speed_kmh": Track(t_ns, np.zeros(299))})
    with pytest.raises(
        LapError, match=r"filling its gaps makes 8[0-9]* samples; a lap made anew has at most"
    ):
        lap_of(recording, repair=True)


def test_two_hours_take_seconds():
    """7.2 million samples are judged and mended within 8 s of CPU time."""
    rng = np.random.default_rng(0)
    t_ns = np.arange(7_200_000) * MS + rng.integers(-100_000, 100_000, 7_200_000)
    values = np.zeros(7_200_000)
    recording = Recording("a.csv", "a.csv", {"speed_kmh": Track(t_ns - t_ns[0], values)})
    before = time.process_time()
    lap_of(recording, repair=True)
    assert time.process_time() - before < 8.0


def test_tracks_share_the_time_all_have():
    """The lap runs from the latest first sample to the earliest last one, at the fastest rate, from zero."""
    lap = lap_of(separate(fork_stroke_mm=np.arange(100, 500, 10), speed_kmh=np.arange(130, 600, 50)))
    assert lap.t_ns.tolist() == (np.arange(0, 361, 10) * MS).tolist()
    np.testing.assert_allclose(lap.channels["fork_stroke_mm"], 10 * (130 + np.arange(0, 361, 10)))
    np.testing.assert_allclose(lap.channels["speed_kmh"], 10 * (130 + np.arange(0, 361, 10)))


def test_tracks_of_some_era_lose_no_nanosecond():
    """Times since 1970 are brought to the grid as exactly as times since start-up."""
    near = separate(fork_stroke_mm=np.arange(0, 300, 10), speed_kmh=np.arange(3, 300, 20))
    far = Recording(
        "a.log",
        "a.log",
        {name: Track(track.t_ns + 1_700_000_000 * S, track.values) for name, track in near.tracks.items()},
        common=False,
    )
    assert lap_of(far) == lap_of(near)


def test_the_maps_rate_is_the_laps():
    """A rate asked for is used; otherwise a rate near whole hertz is taken to be that."""
    times = np.arange(0, 1000, 9.97)
    assert set(np.diff(lap_of(separate(500, speed_kmh=times)).t_ns)) == {2 * MS}
    assert set(np.diff(lap_of(separate(speed_kmh=times)).t_ns)) == {10 * MS}


def test_a_gap_in_a_track_holds_the_last_value():
    """Where a track is silent its last value holds, and the gap is reported under the channel's name."""
    lap = lap_of(
        separate(fork_stroke_mm=np.arange(0, 500, 10), speed_kmh=without(np.arange(0, 500, 10), 201, 280))
    )
    assert lap.channels["speed_kmh"][20:30].tolist() == [2000.0] * 9 + [2900.0]
    assert lap.damage == ("speed_kmh: gap of 90 ms after 0.2 s, sample 20 (1 gap, 0.08 s missing in all)",)


def test_a_short_gap_in_a_track_runs_straight_in_repair():
    """Repaired, a silence of up to 100 ms is bridged by a straight line, a longer one still holds."""
    fork = np.arange(0, 500, 10)
    for last, bridged in ((280, True), (320, False)):
        lap = lap_of(separate(fork_stroke_mm=fork, speed_kmh=without(fork, 201, last)), repair=True)
        assert (lap.channels["speed_kmh"][25] == 2500.0) == bridged


def test_a_track_that_goes_back_is_refused_by_name():
    """A track's step back is refused, naming the channel."""
    with pytest.raises(LapError, match=r"a\.log: speed_kmh: time does not increase at sample 2"):
        lap_of(separate(fork_stroke_mm=[0, 10, 20], speed_kmh=[0, 10, 5]))


def test_a_clock_that_jumps_under_all_tracks_keeps_them_together():
    """Repaired, tracks of different rates mend a common jump by the same amount."""
    t = np.arange(0.0, 4000.0)
    jumped = np.where(t < 2000, t, t - 1500)
    lap = lap_of(
        Recording(
            "a.log",
            "a.log",
            {
                "fork_stroke_mm": Track((jumped * MS).astype(np.int64)[::10], t[::10]),
                "speed_kmh": Track((jumped * MS).astype(np.int64)[3::50], t[3::50]),
            },
            common=False,
        ),
        repair=True,
    )
    np.testing.assert_allclose(lap.channels["fork_stroke_mm"], lap.channels["speed_kmh"], atol=1e-6)
    assert len(lap.damage) == 2


def test_a_track_that_ends_early_is_told():
    """A lap that ends with a track long before the others says which and by how much."""
    lap = lap_of(separate(fork_stroke_mm=np.arange(0, 9000, 10), speed_kmh=np.arange(2000, 4000, 10)))
    assert lap.damage == (
        "speed_kmh: begins 2 s after the first channel; the lap begins with it",
        "speed_kmh: ends 5 s before the last channel; the lap ends with it",
    )


@pytest.mark.parametrize(
    ("recording", "says"),
    [
        (separate(fork_stroke_mm=[0, 10, 20], speed_kmh=[5]), "speed_kmh: 1 samples: a time base needs"),
        (separate(fork_stroke_mm=[0, 10, 20], speed_kmh=[]), "speed_kmh: 0 samples: a time base needs"),
        (
            separate(fork_stroke_mm=[0, 10, 20], speed_kmh=[500, 510]),
            r"no time in common: fork_stroke_mm ends 0\.48 s before speed_kmh begins",
        ),
        (separate(fork_stroke_mm=[0, 10, 20], speed_kmh=[15, 40]), "have 5 ms in common, less than a step"),
        (
            separate(1000, fork_stroke_mm=np.arange(9) * 86_400_000),
            "691200 s every 1 ms makes 691200001 samples; a lap made anew has at most 7200000",
        ),
    ],
)
def test_tracks_that_make_no_lap_are_refused(recording, says):
    """Tracks without a common time, without a rate, or with an absurd one are refused in one line."""
    with pytest.raises(LapError, match=says) as refusal:
        lap_of(recording)
    assert str(refusal.value).startswith("/laps/a.log: ")
