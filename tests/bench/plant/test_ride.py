import numpy as np
import pytest

from bench.errors import RouteError
from bench.laps import CHANNELS
from bench.plant.motorcycle import NAMES, load_motorcycle
from bench.plant.ride import ride
from bench.plant.road.obstacles import Obstacle
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
        stops = (fork > 105) | (fork < 12) | (rear > 97) | (rear < 11)
        assert stops.mean() < 0.005


def test_rear_stroke_lies_where_the_firmware_expects_it(laps):
    """Nearly all of the rear stroke lies within 39.25-80.09 mm (figure V.17), its mean near the middle."""
    for lap in laps:
        rear = lap.channels["rear_stroke_mm"]
        assert np.mean((rear > 39.25) & (rear < 80.09)) > 0.98
        assert 55 < rear.mean() < 64
        assert rear.std() > 4


def test_fork_works_around_a_third_of_its_travel(laps):
    """The fork stroke's mean lies between 30 and 50 of 131 mm along the leg."""
    for lap in laps:
        assert 30 < lap.channels["fork_stroke_mm"].mean() < 50


def test_most_strokes_are_slower_than_400_mm_s(laps):
    """Figure IV.14: stroke velocities under 400 mm/s are the most frequent, and faster ones do occur."""
    for lap in laps:
        for name in ("fork_stroke_mm", "rear_stroke_mm"):
            slow = np.mean(np.abs(np.gradient(lap.channels[name]) * 1e3) < 400)
            assert 0.95 < slow < 0.999


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
    """Over 20 ms, wheel less frame acceleration above it integrates to the fork's speed (section IV.2)."""
    channels = laps[0].channels
    stroke_speed = np.gradient(channels["fork_stroke_mm"])  # mm per ms: m/s
    # the steering head is not above the axle: what pitching adds in between
    ahead = BIKE.to_front_m - BIKE.body_sensor_m
    frame = channels["acc_body_ms2"] - ahead * np.gradient(np.radians(channels["pitch_rate_dps"]), 0.001)
    # 1.0946: the fork slides along the steering axis, the accelerometers measure vertically
    closing = 1.0946 * np.cumsum(channels["acc_front_ms2"] - frame) * 0.001
    change, expected = (speed[20:] - speed[:-20] for speed in (closing, stroke_speed))
    assert np.std(change - expected) < 0.06 * np.std(expected)


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


def test_every_motorcycle_rides_the_mixed_route():
    """Each shipped motorcycle rides a lap with its rear stroke mid-range and no two alike."""
    rides = [ride(ROUTE, load_motorcycle(name), 3, seconds=60) for name in NAMES]
    for lap in rides:
        assert 45 < lap.channels["rear_stroke_mm"].mean() < 75
    assert len({lap.digest() for lap in rides}) == len(NAMES)


def test_bends_turn_the_gyroscope_and_press_the_motorcycle_down():
    """In bends the frame pitches nose up about its own axis, and both strokes are deeper."""
    straight, bends = (
        ride(Route("r", (Stretch(surface="smooth", length_m=2000, speed_kmh=72, lean_deg=lean),)), BIKE, 0)
        for lean in (0.0, 25.0)
    )
    assert bends.channels["pitch_rate_dps"].mean() < straight.channels["pitch_rate_dps"].mean() - 1
    for name in ("fork_stroke_mm", "rear_stroke_mm"):
        assert bends.channels[name].mean() > straight.channels[name].mean() + 1


def test_a_speed_beyond_the_tyres_rating_is_refused():
    """A route faster than the tyre's speed symbol is refused with the speed, the tyre and its rating."""
    slow = BIKE._replace(rear_tyre=BIKE.rear_tyre._replace(fastest_kmh=60.0))
    with pytest.raises(RouteError, match=r"km/h is beyond the tyre model: rear_tyre.fastest_kmh is 60"):
        ride(ROUTE, slow, 0)


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
    bump = Obstacle("bump", first_m=15.0, height_m=0.15, length_m=0.4)
    wall = Route("wall", (Stretch(surface="urban", length_m=100, speed_kmh=120, obstacles=(bump,)),))
    with pytest.raises(RouteError, match=r"wall: (fork|rear)_stroke_mm is .* s, outside 0-1\d0 mm"):
        ride(wall, BIKE, 0)
