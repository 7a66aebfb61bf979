import numpy as np
import pytest

from bench.errors import RouteError
from bench.laps import CHANNELS
from bench.plant.motorcycle import load_motorcycle
from bench.plant.ride import ride, vary
from bench.plant.route import Route, Stretch, load_route

BIKE = load_motorcycle()
ROUTE = load_route("mixed_5km")


@pytest.fixture(scope="module")
def laps():
    return [ride(ROUTE, BIKE, seed) for seed in range(4)]


def test_all_channels_at_one_kilohertz(laps):
    """A lap has the seven channels of section II.5, from time zero, a sample every millisecond."""
    for lap in laps:
        assert tuple(lap.channels) == CHANNELS
        assert lap.t_ns[0] == 0
        assert set(np.diff(lap.t_ns)) == {1_000_000}


def test_a_lap_takes_about_five_minutes(laps):
    """Section IV.1: laps of about 300 s."""
    for lap in laps:
        assert 280 < lap.duration_ns / 1e9 < 320


def test_same_seed_same_bytes(laps):
    """Riding again gives the same lap, byte for byte; another seed gives another."""
    assert ride(ROUTE, BIKE, 0).digest() == laps[0].digest()
    assert len({lap.digest() for lap in laps}) == len(laps)


def test_strokes_stay_in_range_and_off_the_stops(laps):
    """Strokes stay within their sensors' ranges; bump and top-out stops are met for under 0.5 % of a lap."""
    for lap in laps:
        fork, rear = lap.channels["fork_stroke_mm"], lap.channels["rear_stroke_mm"]
        assert 0 <= fork.min() < fork.max() <= 150
        assert 0 <= rear.min() < rear.max() <= 110
        stops = (fork > 105) | (fork < 12) | (rear > 94) | (rear < 11)
        assert stops.mean() < 0.005


def test_rear_stroke_lies_where_the_firmware_expects_it(laps):
    """Nearly all of the rear stroke lies within 39.25-80.09 mm (figure V.17), its mean near the middle."""
    for lap in laps:
        rear = lap.channels["rear_stroke_mm"]
        assert np.mean((rear > 39.25) & (rear < 80.09)) > 0.98
        assert 55 < rear.mean() < 64
        assert rear.std() > 4


def test_fork_works_around_the_middle_of_its_travel(laps):
    """The fork stroke's mean lies between 40 and 60 mm."""
    for lap in laps:
        assert 40 < lap.channels["fork_stroke_mm"].mean() < 60


def test_gyroscope_and_accelerometers_stay_in_range(laps):
    """Pitch rate stays within 80 deg/s, accelerations within the 24 g of the LIS331H."""
    for lap in laps:
        assert np.abs(lap.channels["pitch_rate_dps"]).max() < 80
        for name in ("acc_front_ms2", "acc_rear_ms2", "acc_body_ms2"):
            assert np.abs(lap.channels[name]).max() < 24 * 9.80665


def test_speeds_are_the_routes(laps):
    """Speed spans 30 km/h at the bumps to 90 km/h outside town."""
    for lap in laps:
        speed = lap.channels["speed_kmh"]
        assert 25 < speed.min() < 33
        assert 85 < speed.max() < 100


def test_speed_adds_up_to_the_route(laps):
    """The integral of the speed channel is the length of the route."""
    for lap in laps:
        assert lap.channels["speed_kmh"].sum() / 3.6 * 0.001 == pytest.approx(ROUTE.length_m, abs=0.1)


def test_accelerations_are_the_strokes_second_derivative(laps):
    """Over 20 ms, wheel less steering head acceleration integrates to the fork's speed (section IV.2)."""
    stroke_speed = np.gradient(laps[0].channels["fork_stroke_mm"])  # mm per ms: m/s
    # 1.093: the fork slides along the steering axis, the accelerometers measure vertically
    closing = 1.093 * np.cumsum(laps[0].channels["acc_front_ms2"] - laps[0].channels["acc_body_ms2"]) * 0.001
    change, expected = (speed[20:] - speed[:-20] for speed in (closing, stroke_speed))
    assert np.std(change - expected) < 0.1 * np.std(expected)


def test_seconds_cut_the_lap(laps):
    """A lap cut short is the beginning of the whole one."""
    part = ride(ROUTE, BIKE, 0, seconds=12.5)
    assert len(part.t_ns) == 12_500
    for name, values in part.channels.items():
        # the last samples have no next one to head for
        assert values[:-1].tobytes() == laps[0].channels[name][:12_499].tobytes()


def test_seconds_beyond_the_route_go_round_again():
    """A lap longer than the route has the length asked for."""
    short = Route("short", (Stretch("urban", 200, 50), Stretch("smooth", 100, 70)))
    assert len(ride(short, BIKE, 0, seconds=60).t_ns) == 60_000


def test_training_laps_differ_in_route():
    """Two seeds of the training route ride other speeds at other times."""
    one, other = (ride(load_route("training"), BIKE, seed, seconds=100) for seed in (1, 2))
    speeds = [lap.channels["speed_kmh"] for lap in (one, other)]
    assert np.abs(speeds[0] - speeds[1]).mean() > 5


def test_hidden_load_moves_the_mean_stroke_little():
    """Three kilograms more on the body lower the rear by 0.5 to 1.5 mm."""
    flat = Route("flat", (Stretch("smooth", 100, 50),))
    light, heavy = (
        ride(flat, vary(BIKE, load, 1.0), 0, seconds=2).channels["rear_stroke_mm"][0] for load in (0, 3)
    )
    assert 0.5 < heavy - light < 1.5


def test_more_damping_calms_the_fork():
    """Dampers 30 % stronger lower the spread of the fork's speed."""
    rough = Route("rough", (Stretch("rough_urban", 300, 50),))
    soft, hard = (ride(rough, vary(BIKE, 0.0, c), 0).channels["fork_stroke_mm"] for c in (1.0, 1.3))
    assert np.gradient(hard).std() < 0.95 * np.gradient(soft).std()


def features(lap, lags=30):
    """Rows of 30 lags at 100 Hz of fork stroke and pitch rate, and the speed; and the rear stroke."""
    fork, pitch, speed, rear = (
        lap.channels[name][::10]
        for name in ("fork_stroke_mm", "pitch_rate_dps", "speed_kmh", "rear_stroke_mm")
    )
    columns = [signal[lags - k : len(signal) - k] for signal in (fork, pitch) for k in range(lags)]
    columns += [column * speed[lags:] for column in columns[::2]]
    return np.column_stack([*columns, speed[lags:], np.ones(len(speed) - lags)]), rear[lags:]


def test_rear_stroke_can_be_predicted_from_the_thesiss_inputs():
    """Plain regression on fork stroke, pitch rate and speed predicts an unseen lap's rear stroke to 4 %."""
    rides = [features(ride(load_route("training"), BIKE, seed, seconds=150)) for seed in (100, 101, 102, 103)]
    weights = np.linalg.lstsq(
        np.concatenate([x for x, _ in rides]), np.concatenate([y for _, y in rides]), rcond=None
    )[0]
    x, rear = features(ride(ROUTE, BIKE, 5))
    error = np.mean(np.abs(x @ weights - rear) / rear)
    constant = np.mean(np.abs(np.median(rear) - rear) / rear)
    assert error < 0.04
    assert error < 0.6 * constant


@pytest.mark.parametrize("seconds", [0, -1, 1e9, float("nan")])
def test_refuses_lengths_that_are_none(seconds):
    """A lap has at least two samples and at most two hours."""
    with pytest.raises(RouteError, match=r"a lap of .* s is not from"):
        ride(ROUTE, BIKE, 0, seconds=seconds)


def test_refuses_a_route_of_many_hours():
    """A route of more than two hours is refused before memory is."""
    endless = Route("endless", (Stretch("urban", 100_000, 10),))
    with pytest.raises(RouteError, match="route endless takes 36000 s"):
        ride(endless, BIKE, 0)


def test_refuses_negative_seeds():
    """A negative seed is refused by value."""
    with pytest.raises(RouteError, match="seed is -1, below 0"):
        ride(ROUTE, BIKE, -1)


def test_a_road_that_breaks_the_motorcycle_is_refused():
    """Where a stroke would leave its sensor's range the ride is refused with channel, value and time."""
    wall = Route("wall", (Stretch("urban", 100, 120, bumps=1, bump_height_m=0.15, bump_length_m=0.4),))
    with pytest.raises(RouteError, match=r"wall: (fork|rear)_stroke_mm is .* s, outside 0-1\d0 mm"):
        ride(wall, BIKE, 0)
