"""The decision maker of the core: residual, checks, warm-up and alarm, one stroke after another.

Every test asks a compiled decision maker, handed to it, for its verdicts on a ride; so can be asked the one
on this machine, the one under the sanitizers, and any mutant of either (tests/mutation).
"""

from dataclasses import replace

import numpy as np
import pytest

from targets.calibration import Detector
from targets.detector import Checks
from targets.ifd import residual
from tests.targets.firmware.images import image_of, sealed
from tests.targets.firmware.rides import checked_rides, residual_rides, wild_ride

SINGLE = 1e-6
"""Relative: what single precision may differ over a window's sum."""

NONE, OPEN, SHORT, HOLD, UNCALIBRATION = range(5)

RESIDUAL_AT_ONCE = {"window": 1, "multiple": 1, "warmup": 0}

BLIND = {
    "warmup": 0,
    "rail_steps": 10_000,
    "repeat_steps": 10_000,
    "hold_ratio": 0.0,
    "loss_threshold": 1.0,
    "rail_low_mm": 0.0,
    "rail_high_mm": 110.0,
}
"""Checks of which none finds anything: a test opens the eye it looks at."""


def ask(decide, detector, predicted, measured):
    """The verdicts on a ride of strokes in mm; a single number stands for all of them."""
    p, m = np.broadcast_arrays(np.asarray(predicted, "<f4"), np.asarray(measured, "<f4"))
    return decide(image_of(detector), p, m)


def first(verdicts):
    """The index of the first alarm, -1 for none, and the kind it names."""
    raised = np.flatnonzero(verdicts["alarm"])
    return (int(raised[0]), int(verdicts["kind"][raised[0]])) if len(raised) else (-1, NONE)


# --- what both detectors share ------------------------------------------------------------------------------


def test_ready_when_the_warm_up_is_over(decide):
    """The flag rises with the step that follows the last of the warm-up, and stays up."""
    for detector in (Detector(warmup=5), Checks(warmup=5)):
        assert ask(decide, detector, np.full(20, 50), 50)["ready"].tolist() == [0] * 5 + [1] * 15
    assert ask(decide, Detector(warmup=0), np.full(3, 50), 50)["ready"].tolist() == [1, 1, 1]


def test_nothing_is_said_while_warming_up(decide):
    """Until the warm-up is over there is no alarm and no kind, whatever is measured."""
    for detector in (Detector(**{**RESIDUAL_AT_ONCE, "warmup": 7}), Checks(warmup=7, rail_steps=1)):
        verdicts = ask(decide, detector, np.full(20, 50), 110)
        assert first(verdicts)[0] == 7
        assert not verdicts["kind"][:7].any()


def test_windows_fill_during_the_warm_up(decide):
    """The residual is computed from the first sample on, steps above T are counted after the warm-up."""
    verdicts = ask(decide, Detector(window=4, multiple=1, warmup=6), np.full(20, 25), 50)
    np.testing.assert_allclose(verdicts["residual"][:5], [0.125, 0.25, 0.375, 0.5, 0.5], rtol=SINGLE)
    assert first(verdicts)[0] == 6 + 4 - 1


# --- the residual -------------------------------------------------------------------------------------------


def test_residual_is_equation_v1(decide):
    """The residual is the windowed mean of |y_p - y_m| / |y_m|, from zeros before the first sample."""
    for window in (1, 2, 20, 127, 128):
        detector = Detector(window=window, floor_mm=0.5)
        given = ask(decide, detector, *wild_ride())["residual"]
        expected = residual(*wild_ride(), detector)
        np.testing.assert_allclose(given, expected, rtol=window * SINGLE, atol=1e-7)


def test_small_strokes_divide_by_the_floor(decide):
    """A stroke nearer to zero than the floor, on either side, counts as the floor."""
    detector = Detector(window=1, floor_mm=2.0)
    given = ask(decide, detector, np.full(6, 1.0), [0, 1.5, -1.5, 2, -2, -4])["residual"]
    np.testing.assert_allclose(given, [0.5, 0.25, 1.25, 0.5, 1.5, 1.25], rtol=SINGLE)


def test_residual_at_the_threshold_is_not_above(decide):
    """A residual of exactly T is no alarm, the next larger number is."""
    detector = Detector(threshold=0.25, **RESIDUAL_AT_ONCE)
    assert first(ask(decide, detector, np.full(5, 75), 100))[0] == -1
    assert first(ask(decide, detector, np.full(5, np.nextafter(np.float32(75), np.float32(0))), 100))[0] == 0


def test_alarm_after_n_windows_on_end(decide):
    """The alarm rises with the n L-th sample above T, and falls with the first that is not."""
    detector = Detector(threshold=0.1, window=1, multiple=7, warmup=0)
    above = np.array([0, 1] + [1] * 6 + [0] + [1] * 6 + [0] + [1] * 40 + [0] * 3 + [1] * 8)
    alarm = ask(decide, detector, 100 - 20 * above, 100)["alarm"]
    assert np.flatnonzero(np.diff(alarm.astype(int))).tolist() == [6, 7, 21, 55, 64]


def test_windows_and_multiple_count_together(decide):
    """n windows of L samples are n times L samples."""
    detector = Detector(threshold=0.1, window=3, multiple=5, warmup=0)
    # the window's mean is above T from its first sample on: 0.5 / 3
    assert first(ask(decide, detector, np.full(40, 50), 100))[0] == 14


def test_residual_names_no_kind(decide):
    """The residual's alarm does not say what is wrong."""
    verdicts = ask(decide, Detector(**RESIDUAL_AT_ONCE), np.full(10, 50), 110)
    assert verdicts["alarm"].all()
    assert not verdicts["kind"].any()


def test_residual_decides_as_the_reference(decide):
    """Residual, ready flag and alarm are those of the reference in double precision, whatever is set."""
    changes = 0
    for detector, predicted, measured, expected, alarm in residual_rides():
        verdicts = ask(decide, detector, predicted, measured)
        np.testing.assert_allclose(verdicts["residual"], expected, rtol=10 * SINGLE)
        np.testing.assert_array_equal(verdicts["ready"], np.arange(120) >= detector.warmup)
        np.testing.assert_array_equal(verdicts["alarm"], alarm)
        changes += np.count_nonzero(np.diff(alarm))
    assert changes > 300


# --- the checks: rails --------------------------------------------------------------------------------------

RAILS = {**BLIND, "rail_steps": 4, "rail_gap_mm": 8.0, "rail_low_mm": 1.0, "rail_high_mm": 100.0}


def test_rails_are_open_and_short(decide):
    """The fourth sample in a row at the upper rail is an open sensor, at the lower one a shorted one."""
    detector = Checks(**RAILS)
    assert first(ask(decide, detector, np.full(9, 50), 100)) == (3, OPEN)
    assert first(ask(decide, detector, np.full(9, 50), 108)) == (3, OPEN)
    assert first(ask(decide, detector, np.full(9, 50), 1)) == (3, SHORT)
    assert first(ask(decide, detector, np.full(9, 50), 0)) == (3, SHORT)


def test_next_to_a_rail_is_not_at_it(decide):
    """A stroke one step of the converter inside the rails is as good as any."""
    for measured in (99.99, 1.01):
        assert first(ask(decide, Checks(**RAILS), np.full(9, 50), measured))[0] == -1


def test_rail_that_is_left_counts_anew(decide):
    """Three samples at a rail and one off it are no finding, however often; nor are both rails in turn."""
    for rail, other in ((105, 50), (0, 50), (105, 0), (0, 105)):
        measured = np.tile([rail, rail, rail, other], 5)
        assert first(ask(decide, Checks(**RAILS), np.full(20, 50), measured))[0] == -1


def test_expected_stop_is_no_rail(decide):
    """Where the prediction is within the gap of the rail, or beyond it, the suspension is at its stop."""
    near = {100: (92, 100, 130), 1: (9, 1, -20)}
    off = {100: np.nextafter(np.float32(92), np.float32(0)), 1: np.nextafter(np.float32(9), np.float32(99))}
    for rail, expected in near.items():
        for predicted in expected:
            assert first(ask(decide, Checks(**RAILS), np.full(9, predicted), rail))[0] == -1
        assert first(ask(decide, Checks(**RAILS), np.full(9, off[rail]), rail))[0] == 3


# --- the checks: repeats ------------------------------------------------------------------------------------

REPEATS = {**BLIND, "repeat_steps": 5, "repeat_motion_mm": 2.0}


def moving(n, by=2.0, around=50.0):
    """Predictions that go to and fro by so much in all."""
    return around + by / 2 * np.resize([1.0, -1.0], n)


def test_repeated_value_is_a_hold(decide):
    """Five more samples of the same value, while the prediction moved by 2 mm, are a held sensor."""
    assert first(ask(decide, Checks(**REPEATS), moving(20), 50)) == (5, HOLD)
    assert first(ask(decide, Checks(**REPEATS), moving(20, 1.99), 50))[0] == -1


def test_motion_counts_from_the_first_repeat(decide):
    """What the prediction did before the value began to repeat does not count, its motion since does."""
    predicted, measured = np.full(30, 50.0), np.full(30, 60.0)
    predicted[:10], measured[:10] = moving(10, 40), np.arange(10) + 40
    assert first(ask(decide, Checks(**REPEATS), predicted, measured))[0] == -1
    for to in (48.0, 52.0):
        predicted[22] = to
        assert first(ask(decide, Checks(**REPEATS), predicted, measured)) == (22, HOLD)


def test_another_value_ends_the_repeats(decide):
    """Four repeats and another value are no finding, however often."""
    measured = np.repeat(np.arange(40, 50), 5)
    assert first(ask(decide, Checks(**REPEATS), moving(50), measured))[0] == -1
    assert first(ask(decide, Checks(**REPEATS), moving(60), np.repeat(np.arange(40, 50), 6)))[0] == 5


def test_rail_is_no_repeat(decide):
    """A sensor at a rail repeats its value by nature: that is the rail check's business."""
    for rail in (110, 0):
        assert first(ask(decide, Checks(**REPEATS), moving(20), rail))[0] == -1


# --- the checks: motion -------------------------------------------------------------------------------------

MOTION = {**BLIND, "hold_window": 4, "hold_ratio": 0.5, "still_mm": 2.0}


def test_less_motion_than_predicted_is_a_hold(decide):
    """Half the predicted standard deviation is enough; less than that, once the window is full, is a hold."""
    assert first(ask(decide, Checks(**MOTION), moving(12, 16), moving(12, 8)))[0] == -1
    assert first(ask(decide, Checks(**MOTION), moving(12, 16), moving(12, 7.98))) == (3, HOLD)


def test_still_prediction_proves_nothing(decide):
    """The check speaks where the predicted standard deviation is 2 mm at least."""
    assert first(ask(decide, Checks(**MOTION), moving(12, 4), moving(12, 0.4))) == (3, HOLD)
    assert first(ask(decide, Checks(**MOTION), moving(12, 3.98), moving(12, 0.4)))[0] == -1


def test_window_forgets(decide):
    """A hold is over when the window has forgotten it; a stroke beyond the scale counts as the end of it."""
    detector = Checks(**{**MOTION, "heal_steps": 1})
    measured = np.concatenate([moving(20, 16), np.full(10, 50.0) + np.arange(10) * 1e-3, moving(20, 16)])
    alarm = ask(decide, detector, moving(50, 16), measured)["alarm"]
    assert np.flatnonzero(np.diff(alarm.astype(int))).tolist() == [21, 30]
    assert first(ask(decide, detector, moving(12, 40), 200 + moving(12, 40))) == (3, HOLD)
    assert first(ask(decide, detector, moving(12, 40), moving(12, 40) - 90)) == (3, HOLD)


def test_strokes_are_rounded_to_five_micrometres(decide):
    """A stroke counts as the nearest multiple of 5 um, from 0 to 163 mm; so fine a motion is still one."""
    detector = Checks(**{**MOTION, "still_mm": 0.0})
    # 10000.4 and 10000.6 units are one unit apart, half of what is predicted; 10000.1 and 10000.4 are not
    assert first(ask(decide, detector, moving(12, 0.01), np.resize([50.002, 50.003], 12)))[0] == -1
    assert first(ask(decide, detector, moving(12, 0.01), np.resize([50.0005, 50.002], 12))) == (3, HOLD)
    # the largest float below 16383.5 units, which an addition of more than a half would round up
    assert first(ask(decide, detector, moving(12, 0.01), np.resize([81.917496, 81.92], 12)))[0] == -1
    assert first(ask(decide, detector, moving(12, 1.9), np.resize([162, 163], 12)))[0] == -1
    assert first(ask(decide, detector, moving(12, 1.9), np.resize([163, 164.5], 12))) == (3, HOLD)
    assert first(ask(decide, detector, moving(12, 1.9), np.resize([0, 1], 12)))[0] == -1
    assert first(ask(decide, detector, moving(12, 1.9), np.resize([-1, 0], 12))) == (3, HOLD)


# --- the checks: loss ---------------------------------------------------------------------------------------

LOSS = {**BLIND, "loss_window": 4, "loss_threshold": 0.05, "loss_floor_mm": 5.0, "still_mm": 100.0}


def test_gain_is_an_uncalibration(decide):
    """A mean log ratio beyond the threshold, of either sign, is an uncalibration."""
    for gain, index in ((1.3, 0), (1.06, 3), (1 / 1.06, 3), (1.05, -1), (1 / 1.05, -1)):
        verdicts = ask(decide, Checks(**LOSS), np.full(9, 60), 60 * gain)
        assert first(verdicts) == (index, UNCALIBRATION if index >= 0 else NONE)
        assert verdicts["residual"][-1] == pytest.approx(min(abs(np.log(gain)), 0.30228), rel=1e-4)


def test_loss_at_its_threshold_is_no_finding(decide):
    """A mean log ratio of exactly the threshold is no finding, the least above it is."""
    detector = Checks(**{**LOSS, "loss_window": 1})
    mean = ask(decide, detector, [60], [63])["residual"][0]
    for threshold, index in ((mean, -1), (np.nextafter(mean, np.float32(0)), 0)):
        assert first(ask(decide, replace(detector, loss_threshold=float(threshold)), [60], [63]))[0] == index


def test_loss_counts_in_units(decide):
    """A log ratio is cut to a multiple of 2^-20, so that no sum of them is ever rounded."""
    measured = np.linspace(50, 70, 50)
    units = ask(decide, Checks(**{**LOSS, "loss_window": 1}), np.full(50, 60), measured)["residual"] * 2.0**20
    np.testing.assert_array_equal(units, np.round(units))
    assert len(set(units)) > 40


def test_loss_is_a_signed_mean(decide):
    """Deviations to both sides cancel."""
    measured = 60 * np.resize([1.2, 1 / 1.2], 40)
    assert ask(decide, Checks(**LOSS), np.full(40, 60), measured)["residual"][3::2].max() < 1e-5


def test_small_strokes_count_as_the_floor_of_the_loss(decide):
    """Below the floor neither stroke's size is worth anything."""
    strokes = [0, 3, 5, -4]
    assert not ask(decide, Checks(**LOSS), strokes, strokes[::-1])["residual"].any()
    given = ask(decide, Checks(**{**LOSS, "loss_window": 1}), [0, 5.5], [5.5, 0])["residual"]
    np.testing.assert_allclose(given, np.log(1.1), rtol=1e-4)


def test_one_wild_sample_is_cut_off(decide):
    """However far off, a sample counts as a ratio of 1.35 (z of 0.15)."""
    most = 2 * 0.15 * (1 + 0.15**2 / 3 + 0.15**4 / 5)
    given = ask(decide, Checks(**{**LOSS, "loss_window": 1}), [60, 60, 10, 109], [109, 10, 60, 60])[
        "residual"
    ]
    np.testing.assert_allclose(given, most, rtol=1e-5)


def test_log_ratio_is_a_logarithm(decide):
    """Between the cut-offs the series is the logarithm of the ratio to 1e-5 of it."""
    ratio = np.concatenate([np.linspace(1.02, 1.34, 50), 1 / np.linspace(1.02, 1.34, 50)]).astype("<f4")
    given = ask(decide, Checks(**{**LOSS, "loss_window": 1}), np.full(100, 64), 64 * ratio)["residual"]
    np.testing.assert_allclose(given, np.abs(np.log(ratio.astype(float))), rtol=1e-5, atol=2e-6)


def test_held_off_the_mean_is_a_hold(decide):
    """A loss of a stroke that moves less than half of what it should is a hold, else an uncalibration."""
    detector = Checks(**{**LOSS, "hold_window": 4, "still_mm": 2.0})
    assert first(ask(decide, detector, moving(12, 16), 80 + moving(12, 7.98, 0))) == (0, UNCALIBRATION)
    late = np.concatenate([moving(8, 16), 80 + moving(12, 7.98, 0)])
    # the step itself is motion: only when the window has left it behind does the stroke move less
    steady = Checks(**{**LOSS, "hold_window": 4, "still_mm": 2.0, "warmup": 12})
    assert first(ask(decide, steady, moving(20, 16), late)) == (12, HOLD)
    late = np.concatenate([moving(8, 16), 80 + moving(12, 8.0, 0)])
    assert first(ask(decide, steady, moving(20, 16), late)) == (12, UNCALIBRATION)


# --- the checks: alarm --------------------------------------------------------------------------------------


def test_alarm_heals(decide):
    """After heal_steps on end without a finding the alarm falls and names nothing; a finding starts anew."""
    detector = Checks(**{**RAILS, "rail_steps": 1, "heal_steps": 6})
    measured = np.full(40, 50.0)
    measured[[5, 11]] = 105
    verdicts = ask(decide, detector, np.full(40, 50), measured)
    assert np.flatnonzero(np.diff(verdicts["alarm"].astype(int))).tolist() == [4, 16]
    np.testing.assert_array_equal(verdicts["kind"], OPEN * verdicts["alarm"])


def test_alarm_that_need_not_wait(decide):
    """With heal_steps of 0, too, the alarm falls with the first sample without a finding."""
    image = sealed(image_of(Checks(**{**RAILS, "rail_steps": 1})), heal_steps=0)
    measured = np.array([50, 105, 50, 50, 105, 105, 50], "<f4")
    assert decide(image, np.full(7, 50, "<f4"), measured)["alarm"].tolist() == [0, 1, 0, 0, 1, 1, 0]


def test_alarm_keeps_its_name(decide):
    """What was found first names the alarm until it heals, whatever is found besides."""
    detector = Checks(**{**RAILS, "rail_steps": 1, "heal_steps": 4})
    measured = np.full(30, 50.0)
    measured[[5, 8, 20]] = 105, 0, 0
    kind = ask(decide, detector, np.full(30, 50), measured)["kind"].tolist()
    assert kind == [NONE] * 5 + [OPEN] * 7 + [NONE] * 8 + [SHORT] * 4 + [NONE] * 6


def test_checks_decide_as_the_reference(decide):
    """Alarm and kind are those of the reference in double precision, whatever is set; the loss to single."""
    kinds, changes = np.zeros(5, int), 0
    for checks, predicted, measured, expected in checked_rides():
        verdicts = ask(decide, checks, predicted, measured)
        np.testing.assert_array_equal(verdicts["alarm"], expected.alarm)
        np.testing.assert_array_equal(verdicts["kind"], expected.kind)
        np.testing.assert_allclose(verdicts["residual"], expected.loss, rtol=2 * SINGLE, atol=2 * SINGLE)
        kinds += np.bincount(expected.kind, minlength=5)
        changes += np.count_nonzero(np.diff(expected.kind))
    assert kinds.min() > 300
    assert changes > 2000
